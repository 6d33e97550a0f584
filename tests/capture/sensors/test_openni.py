"""Through the real OpenNI2 library, with sensors that a test driver provides; see virtual_sensor.cpp."""

import gc
from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.sensors import depth_camera, oni_file
from capture.sensors.depth_camera import Selection
from capture.sensors.openni import OpenNIDevice, open_source
from capture.sensors.openni_library import list_sensors, load_openni2
from puppetline.errors import SourceError

from ..conftest import data_of, read, refused

NAME = "openni:"


def test_a_function_that_a_sensor_lacks_is_logged_and_the_others_are_used(sensor, opened, noise, caplog):
    sensor.unplug()
    sensor.plug(refuses=("registration", "synchronisation", "mirror off"))
    device = opened()
    for moment in (1.0, 1.1):
        depth, color = noise()
        sensor.show(depth, color, moment)
        picture = read(device)
    assert caplog.messages == [
        "openni: Puppetline virtual sensor 0 cannot register depth to colour: depth is slightly displaced",
        "openni: the times of depth and colour of Puppetline virtual sensor 0 differ by 5.0 ms",
    ]
    assert_array_equal(picture.color, color)
    assert_array_equal(picture.depth[:, 8:], depth[:, :-8])


def test_a_sensor_that_did_not_open_often_opens_once_it_can_and_closing_stops_it(sensor, noise):
    """Another program may release it; closing a device that did not open would crash the library."""
    sensor.refuse("opening")
    for _ in range(4):
        refused(OpenNIDevice, NAME, Selection())
        assert list_sensors(NAME)[0].error is not None
        gc.collect()
    sensor.refuse()
    for _ in range(3):
        device = OpenNIDevice(NAME, Selection())
        sensor.show(*noise(), 1.0)
        assert read(device).time == 1.0
        assert device.read(0.01) is None
        for _ in range(2):
            device.close()
        assert sensor.streaming == 0


@pytest.mark.parametrize(
    ("states", "says"),
    [
        (False, "does not state whether depth is registered to colour: assuming that it is"),
        (True, "depth is not registered to colour: depth is slightly displaced"),  # by other builds than Debian's
    ],
)
def test_the_log_says_what_a_recording_states_about_its_registration(recording, caplog, monkeypatch, states, says):
    caplog.set_level("INFO", "capture")
    if states:
        library = load_openni2(NAME)
        off = library.IMAGE_REGISTRATION_OFF
        monkeypatch.setattr(library.Device, "get_image_registration_mode", lambda _device: off)
    with closing(OpenNIDevice("openni:file=take.oni", Selection("file", str(recording[0])))):
        [said] = caplog.messages
    assert said.endswith(says)


def test_a_damaged_recording_never_reaches_the_library_and_only_another_process_crashes(
    recording, tmp_path, monkeypatch
):
    monkeypatch.setattr(depth_camera, "load_mediapipe", lambda: None)
    path, content = tmp_path / "damaged.oni", bytearray(recording[0].read_bytes())
    path.write_bytes(content[:10_000_000])
    assert "which is damaged at byte 1" in refused(OpenNIDevice, NAME, Selection("file", str(path))).found
    content[23] = 127  # billions of nodes
    path.write_bytes(content)
    assert (
        refused(open_source, "openni:file=damaged.oni", "file=damaged.oni", tmp_path).found
        == f"{path}, on which OpenNI2 crashes"
    )
    refused(open_source, "openni:file=none.oni", "file=none.oni", tmp_path)


def test_a_recording_on_which_the_library_hangs_is_an_error(recording, monkeypatch):
    monkeypatch.setattr(oni_file, "_PLAY", "import time; time.sleep(60)")
    monkeypatch.setattr(oni_file, "_PLAY_SECONDS", 0.1)
    assert "on which OpenNI2 hangs" in refused(oni_file.check_plays, NAME, recording[0]).found


def test_an_image_with_too_few_bytes_is_skipped(sensor, opened, noise, monkeypatch):
    """OpenNI2 delivers one if the compressed data of a recording are damaged."""
    device = opened()
    pixels, shortened = device._pixels, []

    def first_shortened(kind, frame):
        if shortened:
            return pixels(kind, frame)
        shortened.append(frame)
        return pixels(kind, SimpleNamespace(height=480, width=640, stride=frame.stride, dataSize=1000))

    monkeypatch.setattr(device, "_pixels", first_shortened)
    sensor.show(*noise(), 1.0)
    assert device.read(0.2) is None
    sensor.show(*noise(), 2.0)
    assert read(device).time == 2.0
    assert shortened


def test_damaged_images_are_skipped_and_the_recording_still_ends(recording, opened, tmp_path):
    content = bytearray(recording[0].read_bytes())
    data = data_of(content)
    for k in (6, 7, 18):
        content[data[k]] = np.random.default_rng(3).bytes(data[k].stop - data[k].start)
    damaged = tmp_path / "damaged.oni"
    damaged.write_bytes(content)
    device = opened("file", str(damaged))
    given = []
    with pytest.raises(SourceError):  # noqa: PT012
        while len(given) < 30:
            picture = device.read(0.3)
            given += [] if picture is None else [picture]
    assert [round(10 * picture.time) for picture in given] == [0, 1, 2, 4, 5, 6, 7, 8]


def test_no_image_is_lost_where_a_recording_begins_again(recording, opened):
    """OpenNI2 hands out the earliest frame: here, the first depth of the next pass before the last colours."""
    path, pictures = recording
    device = opened("file", str(path), loop=True)
    for _ in pictures[:-1]:
        read(device)
    while "depth" not in device._waiting:
        device._receive(0.5)
    for _ in range(3):  # each makes OpenNI2 play a frame
        device._oni.wait_for_any_stream([device._streams["depth"]], 0.05)
    for depth, color in (pictures[-1], *pictures):
        picture = read(device)
        assert_array_equal(picture.color, color)
        assert_allclose(picture.depth, depth, rtol=2e-7)


def test_a_recording_can_be_closed_anywhere_many_times(recording):
    """The library crashes if a recording that does not repeat is closed at its end."""
    path, pictures = recording
    for k in range(60):
        with closing(OpenNIDevice(NAME, Selection("file", str(path)))) as device:
            for depth, _ in pictures[: k % 11]:
                assert_array_equal(read(device).depth, depth)
