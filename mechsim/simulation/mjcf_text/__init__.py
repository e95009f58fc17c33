"""Edits the text of MJCF files in place and keeps comments, order and format."""
