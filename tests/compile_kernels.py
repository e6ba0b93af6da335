"""Compile what tests would wait for: python tests/compile_kernels.py SCENE[,SETTING ...]|KIND ...

All in one process: what several of these kernels call is typed and lowered once, where every process would do it anew.
"""

import sys
import warnings

import kaneflex
from kaneflex.multibody.engine import library
from kaneflex.multibody.model.layout import Kind


def main(scenes: list[str]) -> None:
    warnings.simplefilter("ignore", kaneflex.ValidityWarning)
    for each in scenes:
        if each in Kind.__members__:  # of mechanisms that no shipped scene has
            library(Kind[each])
            continue
        name, *settings = each.split(",")
        kaneflex.simulate(kaneflex.load(kaneflex.with_settings(kaneflex.read_scene(name), settings)))


if __name__ == "__main__":
    main(sys.argv[1:])
