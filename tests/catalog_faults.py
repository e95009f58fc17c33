"""Mechanisms of the catalogue built wrong, which every check must reject: name -> fault -> parameters."""

import numpy as np

FAULTS = {
    "bennett": {
        "all links 0.1 % long": {"length0": 0.050 * 1.001},
        "twist of crank and rocker 0.1 deg off": {"twist1": np.deg2rad(63.1)},
    },
    "four_bar": {
        "coupler 0.1 % long": {"coupler": 0.091 * 1.001},
        "other assembly": {"branch": -1},
    },
    "looper": {
        "follower 0.1 % long": {"follower": 0.0133 * 1.001},
        "other side": {"side": -1},
    },
    "rrsrr": {
        "link 0.1 % long": {"link": 0.039 * 1.001},
        "sign of gamma2": {"gamma2": -np.deg2rad(15.0)},
        "other assembly": {"branch": -1},
    },
    "rssr": {
        "coupler 0.1 % long": {"coupler": 0.046 * 1.001},
        "coupler and rocker swapped": {"coupler": 0.0461, "rocker": 0.0269},
        "rocker axis turned by 0.1 deg": {"gamma1": np.deg2rad(20.1)},
        "sign of gamma2": {"gamma2": -np.deg2rad(30.0)},
        "other assembly": {"branch": 1},
    },
    "slider_crank": {
        "rod 0.1 % long": {"rod": 0.2 * 1.001},
        "slide 0.1 mm low": {"offset": 0.0099},
        "other assembly": {"branch": -1},
    },
    "warp_knitter": {
        "gear one tooth in a hundred off": {"gear_ratio": -2.02},
        "other assembly of the triad": {"assembly": 1},
        "rod 5 0.1 % long": {"rod5": 0.049 * 1.001},
    },
}

# parameters for which the crank only swings
SWINGING = {
    "four_bar": {"rocker": 0.035},
    "slider_crank": {"rod": 0.045},
    "rssr": {"rocker": 0.009},
    "rrsrr": {"link": 0.055},
}
# four-bars with change points
COLLINEAR = {
    "parallelogram": {"ground": 0.1, "coupler": 0.1, "crank": 0.04, "rocker": 0.04},
    "kite": {"ground": 0.1, "rocker": 0.1, "crank": 0.04, "coupler": 0.04},
}
