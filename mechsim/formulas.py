"""Base classes of formulas, frames of links and vector algebra: what a user's own formulas import.

FILE.py in the folder of FILE.toml defines a subclass of `ClosedForm`, which yields the `LinkFrame` of links
at crank angles. `TwoBranchForm` adds the discriminant whose sign changes are the dead centres. Vectors are
(3, n), component first. Angles may be jets, so that rates follow from the same formula (`Values`).
"""

# a name that is imported as itself is public for type checkers
from mechsim.kinematics.formulas.closed_form import ClosedForm as ClosedForm
from mechsim.kinematics.formulas.two_branch import TwoBranchForm as TwoBranchForm
from mechsim.kinematics.vector_method.link_frames import LinkFrame as LinkFrame
from mechsim.kinematics.vector_method.vectors import circle_sphere as circle_sphere
from mechsim.kinematics.vector_method.vectors import column as column
from mechsim.kinematics.vector_method.vectors import cross as cross
from mechsim.kinematics.vector_method.vectors import dot as dot
from mechsim.kinematics.vector_method.vectors import norm as norm
from mechsim.kinematics.vector_method.vectors import rotate as rotate
from mechsim.kinematics.vector_method.vectors import rotation as rotation
from mechsim.kinematics.vector_method.vectors import rotation_product as rotation_product
from mechsim.kinematics.vector_method.vectors import sine_of as sine_of
from mechsim.kinematics.vector_method.vectors import triangle_angle as triangle_angle
from mechsim.kinematics.vector_method.vectors import unit_at_angles as unit_at_angles
from mechsim.mechanism.links import EX as EX
from mechsim.mechanism.links import EY as EY
from mechsim.mechanism.links import EZ as EZ
from mechsim.mechanism.links import ORIGIN as ORIGIN
from mechsim.mechanism.links import Vector as Vector
from mechsim.mechanism.motion_laws import Arcs as Arcs
from mechsim.numerics.arrays import Array as Array
from mechsim.numerics.jets import Values as Values
from mechsim.numerics.jets import cos_sin as cos_sin
from mechsim.numerics.jets import values as values
from mechsim.numerics.jets import with_value as with_value
