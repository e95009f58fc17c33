"""Invalid MJCF files, each run by six commands: a correct result or one clear line.

    python validation/robustness/invalid_mjcf.py [--only WORD]

The 69 files are cut off, have another encoding, are no XML, have unknown or wrongly typed components, invalid
numbers, loops that contradict each other or do not close, ranges and keyframes that do not fit, or circular
includes. The script prints the exit codes of each file, the first message, and every fault as
`invalid_models.py` counts them. The exit code is 1 if there was any.
"""

import argparse
import sys

from command_outcomes import Case
from invalid_models import run
from valid_commands import CommandCase

from mechsim import cli

OPTIONS = "--drive crank=60rpm --duration 0.1"
COMMANDS = (
    "show {0} --json",
    "solve {0} -o out.csv",
    "simulate {0} {1} -o out.npz",
    "validate {0} {1} --json",
    "render {0} -o out.png --size 64x48",
    "dynamics inverse {0} {1} --json",
)

# a planar four-bar, closed by one connect
VALID = """<mujoco model="bars">
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


def replaced(*pairs: str) -> bytes:
    """Return the valid file with texts replaced, given as old and new in turn."""
    text = VALID
    for old, new in zip(pairs[::2], pairs[1::2], strict=True):
        if old not in text:
            raise ValueError(f"{old!r} is not in the file")
        text = text.replace(old, new)
    return text.encode()


def appended(section: str, text: str) -> bytes:
    """Return the valid file with text appended to a section."""
    return replaced(f"</{section}>", f"{text}</{section}>")


def nested(depth: int) -> bytes:
    """Return a chain of nested bodies."""
    body = "".join(f'<body name="n{i}"><geom size="0.01"/>' for i in range(depth))
    return replaced("</worldbody>", body + "</body>" * depth + "</worldbody>")


INVALID: dict[str, bytes] = {
    "valid": VALID.encode(),
    "empty": b"",
    "blank": b" \n\t\n",
    "prose": b"dear all,\nplease find the model attached",
    "binary data": bytes(range(256)) * 8,
    "cut in a tag": VALID.encode()[:300],
    "cut between tags": VALID.encode()[: VALID.index("</worldbody>")],
    "UTF-16": VALID.encode("utf-16"),
    "Latin-1": VALID.replace("bars", "b\u00e4rs").encode("latin-1"),
    "with a byte order mark": b"\xef\xbb\xbf" + VALID.encode(),
    "a zero byte": VALID.encode().replace(b"bars", b"ba\0rs"),
    "two roots": (VALID + VALID).encode(),
    "HTML": b"<!DOCTYPE html><html><body>404: Not Found</body></html>",
    "a pointer to large storage": b"version https://git-lfs.github.com/spec/v1\noid sha256:12\nsize 9\n",
    "URDF": b'<robot name="r"><link name="a"/></robot>',
    "SDF": b'<sdf version="1.6"><model name="r"/></sdf>',
    "no elements": b"<mujoco/>",
    "no bodies": b"<mujoco><worldbody><geom size='1'/></worldbody></mujoco>",
    "no joints": b"<mujoco><worldbody><body><geom size='1'/></body></worldbody></mujoco>",
    "an unknown element": replaced("<worldbody>", "<worldbody><bodie/>"),
    "an unknown attribute": replaced('<body name="c"', '<body colour="red" name="c"'),
    "text for a number": replaced('pos="0.04 0 0"', 'pos="four 0 0"'),
    "too few numbers": replaced('pos="0.04 0 0"', 'pos="0.04 0"'),
    "too many numbers": replaced('pos="0.04 0 0"', 'pos="0.04 0 0 0"'),
    "a comma in a number": replaced('pos="0.04 0 0"', 'pos="0,04 0 0"'),
    "NaN": replaced('pos="0.04 0 0"', 'pos="nan 0 0"'),
    "infinite": replaced('pos="0.04 0 0"', 'pos="inf 0 0"'),
    "a tiny mechanism": replaced('pos="0.04 0 0"', 'pos="1e-300 0 0"'),
    "an axis of zero": replaced('name="elbow" axis="0 0 1"', 'name="elbow" axis="0 0 0"'),
    "a joint of unknown type": replaced('name="elbow"', 'name="elbow" type="screw"'),
    "a joint on the world": replaced("<worldbody>", '<worldbody><joint name="x"/>'),
    "a duplicate name": replaced('name="rocker"', 'name="elbow"'),
    "names in other scripts": replaced(
        "crank", "crank", "rocker", "\u041a\u043e\u0440\u043e\u043c\u044b\u0441\u043b\u043e \U0001f980"
    ),
    "names with blanks and quotes": replaced('name="rocker"', 'name=" a &quot;b&quot;=c,d\t"'),
    "no such site": replaced('site2="Q"', 'site2="R"'),
    "no such body": appended("equality", '<weld body1="a" body2="z"/>'),
    "no such joint": appended("equality", '<joint joint1="elbow" joint2="knee"/>'),
    "no such actuated joint": replaced('<motor joint="crank"/>', '<motor joint="crnk"/>'),
    "no such class": replaced(CRANK, CRANK.replace("/>", ' class="heavy"/>')),
    "a connect to itself": appended("equality", '<connect body1="a" body2="a" anchor="0 0 0"/>'),
    "one site and one body": appended("equality", '<connect site1="P" body2="a" anchor="0 0 0"/>'),
    "no mass": replaced('<geom size="0.01"/>', '<geom size="0.01" mass="0"/>'),
    "a negative mass": replaced(
        '<geom size="0.01"/>\n      <body', '<geom size="0.01" mass="-1"/>\n      <body'
    ),
    "inertias of no rigid body": replaced(
        '<geom size="0.01"/>\n      <body',
        '<inertial pos="0 0 0" mass="1" diaginertia="9 1 1"/>\n      <body',
    ),
    "a loop-closure error of 1 mm": replaced(Q, '"0.021 0.08 0"'),
    "a loop-closure error of 1 m": replaced(Q, '"1.02 0.08 0"'),
    "a loop-closure error out of plane": replaced(Q, '"0.02 0.08 0.001"'),
    "two loops that contradict": appended("equality", '<connect body1="b" body2="c" anchor="0.03 0.01 0"/>'),
    "a coupling that contradicts": appended(
        "equality",
        '<joint joint1="elbow" polycoef="1 0 0 0 0"/><joint joint1="elbow" polycoef="0.5 0 0 0 0"/>',
    ),
    "a joint coupled to itself": appended("equality", '<joint joint1="elbow" joint2="elbow"/>'),
    "a redundant driver": appended("actuator", '<motor joint="rocker"/>'),
    "a range without the start": replaced(CRANK, CRANK.replace("/>", ' range="1 2"/>')),
    "a reversed range": replaced(CRANK, CRANK.replace("/>", ' range="2 1"/>')),
    "a range of one point": replaced(CRANK, CRANK.replace("/>", ' range="0.3 0.3"/>')),
    "a keyframe too short": replaced('qpos="0.3 0 0"', 'qpos="0.3 0"'),
    "a keyframe that is not finite": replaced('qpos="0.3 0 0"', 'qpos="nan 0 0"'),
    "includes itself": replaced("<worldbody>", '<include file="model.xml"/><worldbody>'),
    "a missing include": replaced("<worldbody>", '<include file="parts/no.xml"/><worldbody>'),
    "a missing mesh": replaced(
        "<worldbody>", '<asset><mesh name="m" file="no.stl"/></asset><worldbody><geom type="mesh" mesh="m"/>'
    ),
    "a mesh of unknown format": replaced(
        "<worldbody>", '<asset><mesh name="m" file="no.step"/></asset><worldbody>'
    ),
    "a missing plugin": replaced(
        "<worldbody>", '<extension><plugin plugin="no.such.thing"/></extension><worldbody>'
    ),
    "a timestep of zero": replaced("<worldbody>", '<option timestep="0"/><worldbody>'),
    "a negative timestep": replaced("<worldbody>", '<option timestep="-1"/><worldbody>'),
    "bodies 60 deep": nested(60),
    "bodies 3000 deep": nested(3000),
    "expanding entities": b'<!DOCTYPE l [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]>\n'
    + VALID.replace("bars", "&b;").encode(),
    "a distance": appended("equality", '<flex flex="f"/>'),
    "a base on a mocap body": replaced('<body name="c"', '<body mocap="true" name="c"'),
    "a free body without mass": replaced("<worldbody>", '<worldbody><body name="f"><freejoint/></body>'),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", default="", help="files whose label contains this word")
    only = parser.parse_args().only
    for name in cli.COMMANDS:
        cli.load_command(name)
    failures = 0
    for label, content in INVALID.items():
        if only not in label:
            continue
        codes, output, faults = [], "", []
        for line in COMMANDS:
            words = tuple(line.format("model.xml", OPTIONS).split())
            code, last, command_faults, _ = run(CommandCase(label, Case(words, {"model.xml": content})))
            codes.append(str(code))
            output = output or (last if code else "")
            faults += [f"{words[0]}: {item}" for item in command_faults]
        failures += bool(faults)
        print(f"{label:36s} {' '.join(codes)}  {output}", flush=True)
        for fault in faults:
            print(f"    FAULT {fault}", flush=True)
    print(f"\n{failures} files with faults")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
