"""A model with every kind of equality constraint."""

from model_files import model_text

KINDS = {
    "connect of bodies": '<connect body1="b2" body2="f" anchor=".02 .01 -.03"/>',
    "connect of sites": '<connect site1="s" site2="t"/>',
    "weld of bodies": '<weld body1="b2" body2="f"/>',
    "weld with an anchor": '<weld body1="f" body2="c" anchor=".02 .01 -.03"/>',
    "weld with a pose": '<weld body1="b2" body2="f" anchor=".01 0 0" relpose=".1 .2 .3 .9 .1 -.2 .3"/>',
    "weld to the world": '<weld body1="c"/>',
    "weld of sites": '<weld site1="s" site2="t"/>',
    "weld of a site to the world": '<weld site1="w" site2="t"/>',
    "joint by joint": '<joint joint1="j" joint2="crank" polycoef=".1 .2 .3 .4 .5"/>',
    "one joint": '<joint joint1="s1" polycoef=".1 0 0 0 0"/>',
    "tendon by tendon": '<tendon tendon1="one" tendon2="two" polycoef=".1 .2 .3 .4 .5"/>',
    "one tendon": '<tendon tendon1="one" polycoef=".1 0 0 0 0"/>',
}


def text_with(equality: str) -> str:
    """Return the text of the model with an equality constraint."""
    return model_text("loop_constraints_model.xml").replace("EQUALITY", equality)
