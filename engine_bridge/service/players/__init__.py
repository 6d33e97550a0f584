"""The players of characters: calibration, retargeting and easing of one character each."""
