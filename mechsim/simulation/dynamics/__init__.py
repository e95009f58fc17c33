"""Forces in MuJoCo: what a driven crank needs, and how a crank runs freely."""
