"""Choice of the threshold on U and of its scale, from one ordinary drive or from several drives of one road.

`one_drive` keeps rejections of ordinary scans rare; `road` keeps wrong answers rare. docs/calibration.md says what is
certain of either.
"""
