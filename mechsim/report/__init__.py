"""What is told of a mechanism or a study, on a page or in a notebook."""
