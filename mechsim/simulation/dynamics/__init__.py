"""Dynamics in MuJoCo: forces of a driven crank, and motion of a free crank."""
