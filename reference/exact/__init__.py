"""Mechanisms in as many digits as are asked for, from nothing but their TOML files: no part of mechsim."""
