"""What a machine is and what a motion is: plain data, the only language the two roads have in common."""
