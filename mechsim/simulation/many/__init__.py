"""Many designs of one mechanism stepped in MuJoCo together: one compiled model, numbers of each."""
