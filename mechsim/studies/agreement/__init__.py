"""A model held against a user's own formula or table: whether they agree, and why not."""
