"""Proofs by interval arithmetic that a motion has one regular configuration at each driver position."""

from mechsim.studies.certify.certificate import Certificate, certify

__all__ = ["Certificate", "certify"]
