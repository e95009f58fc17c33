"""MJCF files with something wrong, each through the commands of its kind: a true result or one clear line.

    python validation/robustness/invalid_mjcf.py [--only WORD]

Forty and more files: cut off, in another encoding, no XML, with unknown or wrongly typed parts, numbers that
are none, loops that contradict each other or do not close, holds and keyframes that do not fit, includes in
a circle, what MuJoCo takes and no mechanism is made of. Prints for each file the exit codes and what `show`
and `simulate` said, and every fault as `invalid_models.py` counts them; the exit code is 1 if there was any.
"""

import argparse
import sys

from command_outcomes import Case
from invalid_models import run
from valid_commands import Tried

from mechsim import cli

DRIVEN = "--drive crank=60rpm --duration 0.1"
COMMANDS = (
    "show {0} --json",
    "solve {0} -o out.csv",
    "simulate {0} {1} -o out.npz",
    "validate {0} {1} --json",
    "render {0} -o out.png --size 64x48",
    "dynamics {0} {1} --json",
)

# a four-bar in a plane, closed by one connect
SOUND = """<mujoco model="bars">
  <compiler angle="radian" autolimits="true"/>
  <worldbody>
    <body name="a"><joint name="crank" axis="0 0 1" ref="0.3"/><geom size="0.01"/>
      <body name="b" pos="0.04 0 0"><joint name="elbow" axis="0 0 1"/><geom size="0.01"/>
        <site name="P" pos="0.07 0.05 0"/></body></body>
    <body name="c" pos="0.09 -0.03 0"><joint name="rocker" axis="0 0 1"/><geom size="0.01"/>
      <site name="Q" pos="0.02 0.08 0"/></body>
  </worldbody>
  <equality><connect name="closing" site1="P" site2="Q"/></equality>
  <actuator><motor joint="crank"/></actuator>
  <keyframe><key name="home" qpos="0.3 0 0"/></keyframe>
</mujoco>
"""
Q, CRANK = '"0.02 0.08 0"', '<joint name="crank" axis="0 0 1" ref="0.3"/>'


def changed(*pairs: str) -> bytes:
    """Return the sound file with parts of it replaced, old and new in turn."""
    text = SOUND
    for old, new in zip(pairs[::2], pairs[1::2], strict=True):
        if old not in text:
            raise ValueError(f"{old!r} is not in the file")
        text = text.replace(old, new)
    return text.encode()


def added(section: str, text: str) -> bytes:
    """Return the sound file with something put at the end of a section."""
    return changed(f"</{section}>", f"{text}</{section}>")


def nested(depth: int) -> bytes:
    """Return a chain of bodies one inside the other."""
    body = "".join(f'<body name="n{i}"><geom size="0.01"/>' for i in range(depth))
    return changed("</worldbody>", body + "</body>" * depth + "</worldbody>")


BROKEN: dict[str, bytes] = {
    "sound": SOUND.encode(),
    "empty": b"",
    "blank": b" \n\t\n",
    "prose": b"dear all,\nplease find the model attached",
    "a picture": bytes(range(256)) * 8,
    "cut in a tag": SOUND.encode()[:300],
    "cut between tags": SOUND.encode()[: SOUND.index("</worldbody>")],
    "UTF-16": SOUND.encode("utf-16"),
    "Latin-1": SOUND.replace("bars", "b\u00e4rs").encode("latin-1"),
    "with a byte order mark": b"\xef\xbb\xbf" + SOUND.encode(),
    "a nought byte": SOUND.encode().replace(b"bars", b"ba\0rs"),
    "two roots": (SOUND + SOUND).encode(),
    "HTML": b"<!DOCTYPE html><html><body>404: Not Found</body></html>",
    "a pointer to large storage": b"version https://git-lfs.github.com/spec/v1\noid sha256:12\nsize 9\n",
    "URDF": b'<robot name="r"><link name="a"/></robot>',
    "SDF": b'<sdf version="1.6"><model name="r"/></sdf>',
    "nothing in it": b"<mujoco/>",
    "no bodies": b"<mujoco><worldbody><geom size='1'/></worldbody></mujoco>",
    "no joints": b"<mujoco><worldbody><body><geom size='1'/></body></worldbody></mujoco>",
    "an unknown element": changed("<worldbody>", "<worldbody><bodie/>"),
    "an unknown attribute": changed('<body name="c"', '<body colour="red" name="c"'),
    "text for a number": changed('pos="0.04 0 0"', 'pos="four 0 0"'),
    "too few numbers": changed('pos="0.04 0 0"', 'pos="0.04 0"'),
    "too many numbers": changed('pos="0.04 0 0"', 'pos="0.04 0 0 0"'),
    "a comma in a number": changed('pos="0.04 0 0"', 'pos="0,04 0 0"'),
    "NaN": changed('pos="0.04 0 0"', 'pos="nan 0 0"'),
    "infinite": changed('pos="0.04 0 0"', 'pos="inf 0 0"'),
    "a tiny mechanism": changed('pos="0.04 0 0"', 'pos="1e-300 0 0"'),
    "an axis of nought": changed('name="elbow" axis="0 0 1"', 'name="elbow" axis="0 0 0"'),
    "a joint of no kind": changed('name="elbow"', 'name="elbow" type="screw"'),
    "a joint on the world": changed("<worldbody>", '<worldbody><joint name="x"/>'),
    "a name twice": changed('name="rocker"', 'name="elbow"'),
    "names in other scripts": changed(
        "crank", "crank", "rocker", "\u041a\u043e\u0440\u043e\u043c\u044b\u0441\u043b\u043e \U0001f980"
    ),
    "names of blanks and quotes": changed('name="rocker"', 'name=" a &quot;b&quot;=c,d\t"'),
    "no such site": changed('site2="Q"', 'site2="R"'),
    "no such body": added("equality", '<weld body1="a" body2="z"/>'),
    "no such joint": added("equality", '<joint joint1="elbow" joint2="knee"/>'),
    "no such actuated joint": changed('<motor joint="crank"/>', '<motor joint="crnk"/>'),
    "no such class": changed(CRANK, CRANK.replace("/>", ' class="heavy"/>')),
    "a connect to itself": added("equality", '<connect body1="a" body2="a" anchor="0 0 0"/>'),
    "one site and one body": added("equality", '<connect site1="P" body2="a" anchor="0 0 0"/>'),
    "no mass": changed('<geom size="0.01"/>', '<geom size="0.01" mass="0"/>'),
    "a mass below nought": changed(
        '<geom size="0.01"/>\n      <body', '<geom size="0.01" mass="-1"/>\n      <body'
    ),
    "inertias of no body": changed(
        '<geom size="0.01"/>\n      <body',
        '<inertial pos="0 0 0" mass="1" diaginertia="9 1 1"/>\n      <body',
    ),
    "a loop open by 1 mm": changed(Q, '"0.021 0.08 0"'),
    "a loop open by 1 m": changed(Q, '"1.02 0.08 0"'),
    "a loop open across its plane": changed(Q, '"0.02 0.08 0.001"'),
    "two loops that contradict": added("equality", '<connect body1="b" body2="c" anchor="0.03 0.01 0"/>'),
    "a coupling that contradicts": added(
        "equality",
        '<joint joint1="elbow" polycoef="1 0 0 0 0"/><joint joint1="elbow" polycoef="0.5 0 0 0 0"/>',
    ),
    "a joint coupled to itself": added("equality", '<joint joint1="elbow" joint2="elbow"/>'),
    "a drive too many": added("actuator", '<motor joint="rocker"/>'),
    "a range that leaves the start out": changed(CRANK, CRANK.replace("/>", ' range="1 2"/>')),
    "a range turned round": changed(CRANK, CRANK.replace("/>", ' range="2 1"/>')),
    "a range that is a point": changed(CRANK, CRANK.replace("/>", ' range="0.3 0.3"/>')),
    "a keyframe too short": changed('qpos="0.3 0 0"', 'qpos="0.3 0"'),
    "a keyframe that is not finite": changed('qpos="0.3 0 0"', 'qpos="nan 0 0"'),
    "includes itself": changed("<worldbody>", '<include file="model.xml"/><worldbody>'),
    "includes what is not there": changed("<worldbody>", '<include file="parts/no.xml"/><worldbody>'),
    "a mesh that is not there": changed(
        "<worldbody>", '<asset><mesh name="m" file="no.stl"/></asset><worldbody><geom type="mesh" mesh="m"/>'
    ),
    "a mesh of no kind": changed("<worldbody>", '<asset><mesh name="m" file="no.step"/></asset><worldbody>'),
    "a plugin that is not there": changed(
        "<worldbody>", '<extension><plugin plugin="no.such.thing"/></extension><worldbody>'
    ),
    "a timestep of nought": changed("<worldbody>", '<option timestep="0"/><worldbody>'),
    "a timestep below nought": changed("<worldbody>", '<option timestep="-1"/><worldbody>'),
    "bodies 60 deep": nested(60),
    "bodies 3000 deep": nested(3000),
    "entities that grow": b'<!DOCTYPE l [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]>\n'
    + SOUND.replace("bars", "&b;").encode(),
    "a distance": added("equality", '<flex flex="f"/>'),
    "a base on a mocap body": changed('<body name="c"', '<body mocap="true" name="c"'),
    "a free body without mass": changed("<worldbody>", '<worldbody><body name="f"><freejoint/></body>'),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", default="", help="files with a word in what is wrong with them")
    only = parser.parse_args().only
    for name in cli.COMMANDS:
        cli.load_command(name)
    faulty = 0
    for what, content in BROKEN.items():
        if only not in what:
            continue
        codes, output, faults = [], "", []
        for line in COMMANDS:
            words = tuple(line.format("model.xml", DRIVEN).split())
            code, last, wrong, _ = run(Tried(what, Case(words, {"model.xml": content})))
            codes.append(str(code))
            output = output or (last if code else "")
            faults += [f"{words[0]}: {item}" for item in wrong]
        faulty += bool(faults)
        print(f"{what:36s} {' '.join(codes)}  {output}", flush=True)
        for fault in faults:
            print(f"    FAULT {fault}", flush=True)
    print(f"\n{faulty} files with faults")
    return 1 if faulty else 0


if __name__ == "__main__":
    sys.exit(main())
