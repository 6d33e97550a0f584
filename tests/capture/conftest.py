"""Fixtures of the sensors: one set of virtual devices serves all tests of a process, as OpenNI2 starts once."""

from .devices import (
    _virtual_sensors,
    fakenect,
    openni_folder,
    record,
    render,
    run_with_kinect,
    scripted_device,
    scripted_tracker,
    standing,
    virtual_sensors,
    watch,
    write_dump,
)

__all__ = [
    "_virtual_sensors",
    "fakenect",
    "openni_folder",
    "record",
    "render",
    "run_with_kinect",
    "scripted_device",
    "scripted_tracker",
    "standing",
    "virtual_sensors",
    "watch",
    "write_dump",
]
