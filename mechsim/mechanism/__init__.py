"""Mechanisms and motions as plain data, shared by both methods."""
