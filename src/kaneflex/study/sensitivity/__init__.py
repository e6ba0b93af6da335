"""Derivatives of a run's sensors with respect to numbers of its scene.

    parameters   a path of the scene -> Parameter: its value and unit, and the scene with another value
    varied       Model and Parameter -> Varied: the model's constants and scalars with their slopes
    tangent      Varied -> the slope of the motion: the same discrete steps, differentiated
    coupled      the same of a coupled run, and of its sensors
    report       Solution -> Sensitivities: the slope of every sensor, and of its extremes
"""
