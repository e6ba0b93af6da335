"""Derivatives of a run's sensors with respect to numbers of its scene.

    parameters   a path of the scene -> Parameter: its value and unit, and the scene with another value
    neighbours   Model and Parameter -> four models whose parameter differs a little; the slope through their values
    replay       the runs of a coupled model's neighbours, in the steps that its own run has taken
    slopes       Solution and Parameters -> the slope of every sensor, in steps as small as it takes
    report       Solution -> Sensitivities: those slopes with units, and those of the extremes
"""
