"""Every error mechsim raises on purpose: one sentence with the thing, the value, the bound, the remedy."""


class MechsimError(Exception):
    """Base of all errors a user can mend; the command line prints its text and exits with 2."""


class InputError(MechsimError, ValueError):
    """A name, value, unit, file or option that cannot be used as given."""


class AssemblyError(MechsimError, ValueError):
    """The loops cannot be closed at a crank angle that was asked for."""


class MobilityError(MechsimError, ValueError):
    """A mechanism whose motion its drivers do not settle, or that has more drivers than freedoms.

    Attributes:
        outcome: "undetermined" or "overdriven".
    """

    def __init__(self, message: str, outcome: str = "undetermined"):
        super().__init__(message)
        self.outcome = outcome


class OutputError(MechsimError, OSError):
    """A result cannot be written where it was asked to go."""


class MissingToolError(MechsimError, RuntimeError):
    """This machine lacks something (OpenGL, ffmpeg); the text names the package that brings it."""
