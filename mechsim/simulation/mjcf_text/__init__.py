"""Edits the text of MJCF files in place: comments, order and format stay as their authors have them."""
