"""A mechanism in a page that needs nothing but itself, to turn by hand.

All that moves was solved before: the page interpolates between dense samples and solves nothing.
"""
