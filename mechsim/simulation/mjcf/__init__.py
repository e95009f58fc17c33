"""Generates MuJoCo models of mechanisms from dimensions only, compiles them, and writes exact text."""
