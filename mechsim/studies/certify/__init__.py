"""Proofs by interval arithmetic that a motion has one regular configuration at each driver position."""

from mechsim.studies.certify.certificate import Certificate, SingularPoint, certify

__all__ = ["Certificate", "SingularPoint", "certify"]
