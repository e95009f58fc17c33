"""Certificates of all mechanisms of the catalogue and the gallery over their range, with times.

Exits with 1 if a mechanism without a singularity is not certified, unless it is overconstrained, if a
singular point of another is not enclosed to 1e-9 rad, or if all take more than a minute of processor time.
"""

import sys
import time

import mechsim as ms

# these loops close only with exact dimensions, not with rounded ones
OVERCONSTRAINED = {"bennett", "double_cardan"}
# processor time of all certificates
MAX_SECONDS = 60.0


def main():
    failed, start = [], time.process_time()
    for name in [name for group in ("mechanisms", "gallery") for name in ms.list()[group]]:
        begin = time.process_time()
        try:
            proof = ms.certify(name)
        except ms.InputError as error:
            # couplings by functions, as of cams
            print(f"{name:19s} refused   {error}")
            continue
        seconds = time.process_time() - begin
        outcome = "certified" if proof.certified else "not"
        points = ", ".join(f"{p.kind} {p.parameter:.10f} ± {p.width:.0e}" for p in proof.singular)
        print(
            f"{name:19s} {outcome:9s} {seconds:5.2f} s {proof.segments:5d} segments "
            f"singular value >= {proof.min_singular_value:.2g} tube {proof.tube:.1e}  {points}"
        )
        located = proof.singular and all(point.width < 1e-9 for point in proof.singular)
        if not (proof.certified or located or name in OVERCONSTRAINED):
            failed.append(name)
    total = time.process_time() - start
    print(f"{total:.1f} s; neither certified nor located: {', '.join(failed) or 'none'}")
    return bool(failed) or total > MAX_SECONDS


if __name__ == "__main__":
    sys.exit(main())
