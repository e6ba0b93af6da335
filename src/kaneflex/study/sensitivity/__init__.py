"""Derivatives of a run's sensors with respect to numbers of its scene.

    parameters   a path of the scene -> Parameter: its value and unit, and the scene with another value
    slopes       Solution and Parameters -> the slope of every sensor through four neighbours, models whose parameter
                 differs a little, in steps as small as it takes
    replay       the run of a coupled model's neighbour, in the steps that its own run has taken
    report       Solution -> Sensitivities: those slopes with units, and those of the extremes
"""
