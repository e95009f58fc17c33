"""Generated solvers: one C99 header or JavaScript file from the loop equations of a mechanism."""
