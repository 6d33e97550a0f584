"""Checks of `puppetline doctor`."""
