"""Reports of a source that has given some frames."""

import numpy as np
from puppetline.examples.performances import PERFORMANCES

from capture.sensors.source_report import SourceReport
from capture.skeleton import SkeletonFrame
from capture.trackers.picture import Lens

LENS = Lens(640, 480, 525.0)
WALK = PERFORMANCES["walk"]()


def frame(number, user=1, confidence=1.0, moved=(0, 0, 0)):
    """Return a frame of a performer who walks about 3 m away."""
    confidences = np.full(20, confidence, np.float32)
    return SkeletonFrame(number / 30, user, WALK.positions[number] + moved, confidences)


def report_of(events=(), picture=None, **attributes):
    """Return the report of a source that has given events."""
    report = SourceReport("test:", **{"listens": False, "seconds": 3.0, "received": 90, **attributes}, picture=picture)
    for event in events:
        report.add(event)
    return report
