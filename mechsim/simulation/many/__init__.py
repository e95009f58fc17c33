"""Many designs of one mechanism stepped together: one compiled model with the fields of each design."""
