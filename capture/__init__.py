"""Skeletons in: sensors, network senders and recorded logs. Knows no mesh and no engine."""
