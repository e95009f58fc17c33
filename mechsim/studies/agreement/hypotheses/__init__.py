"""What may have gone wrong in somebody's model: one file for each family of mistakes, and a table of them."""
