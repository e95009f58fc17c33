"""The table of hypotheses: a new family is a function in a file beside, and a row here."""

from collections.abc import Callable, Iterator

from mechsim.studies.agreement.hypotheses import of_assembly, of_dimensions, of_drivers, of_loads, of_values
from mechsim.studies.agreement.hypotheses.hypothesis import Hypothesis
from mechsim.studies.agreement.miss import Miss

Family = Callable[[Miss], Iterator[Hypothesis]]

# those of a later stage are asked only where none of the stages before explains all: first what has no size,
# then what has one, then places without a name, last what has several sizes
STAGES: tuple[tuple[Family, ...], ...] = (
    (
        of_values.units,
        of_values.degrees,
        of_values.swapped,
        of_values.mirrored,
        of_values.senses,
        of_drivers.driver_senses,
        of_drivers.driver_degrees,
        of_drivers.drivers_swapped,
        of_assembly.assemblies,
        of_dimensions.gear_slips,
        of_loads.other_gravity,
    ),
    (
        of_values.zeros,
        of_values.frame,
        of_drivers.driver_offsets,
        of_drivers.delays,
        of_dimensions.parameters,
        of_loads.gravity_size,
        of_loads.masses,
    ),
    (of_dimensions.places,),
    (of_values.whole_frame,),
)
