"""A self-contained interactive 3-D page of a mechanism.

All motions are solved before: the page interpolates between dense samples.
"""
