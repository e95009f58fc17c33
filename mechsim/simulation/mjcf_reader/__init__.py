"""Reads MJCF files as mechanisms: copies positions, axes, anchors and couplings, and solves nothing."""

from mechsim.simulation.mjcf_reader.parsed_file import MujocoInput, model_label
from mechsim.simulation.mjcf_reader.reading import MjcfModel, read_model, states_of

__all__ = ["MjcfModel", "MujocoInput", "model_label", "read_model", "states_of"]
