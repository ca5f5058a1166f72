"""The probability that an answer is right, the gate on it and the threshold on U, from one drive or from several.

`one_drive` shifts shipped coefficients to the sensor; `road` learns them, and keeps wrong answers rare.
docs/calibration.md says what is certain of either.
"""
