"""The cheapest settings with which plain MuJoCo keeps a tolerance on a user's own scene and motion."""
