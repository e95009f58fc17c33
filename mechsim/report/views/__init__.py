"""What a page to turn by hand shows: motions of every assembly, of programs, of several drivers by hand."""

from mechsim.report.views.judged_motion import case_view
from mechsim.report.views.whole_view import mechanism_view

__all__ = ["case_view", "mechanism_view"]
