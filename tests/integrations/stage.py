"""A publisher in the service's place, with one character: it sends what a test has it send."""

import threading
import time
from dataclasses import replace

import numpy as np
import zmq

from engine_bridge.performance.clip import load_timeline, solve
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.performance.settings import Settings
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.protocol.header import FRAME_KINDS, WORDS, Header, Kind, join, topic_field, write_json
from engine_bridge.service.protocol.payloads import encode
from engine_bridge.service.protocol.scene import DecodedScene, StreamedCharacter
from engine_bridge.service.states import STATES

FPS = 30


def performed(puppet, take, settings=None, basis=None):
    """Return the frames of a take, a few hundred at most."""
    prepared, settings = load_prepared(puppet), settings or Settings()
    timeline, _ = load_timeline(take, settings)
    motion = solve(prepared, timeline, settings)
    character = StreamedCharacter.of(puppet.stem, prepared, basis and basis(prepared))
    poses = (replace(motion[k], R=np.float64(motion[k].R)) for k in range(min(300, len(motion))))
    return [Frame(character, k, (k - 1) / FPS, 0, "performing", 1, pose) for k, pose in enumerate(poses, 1)]


class Stage:
    """Sends the scene to who asks for it, and frames as soon as somebody has asked for both."""

    def __init__(self, frames):
        self.character = frames[0].character
        scene = DecodedScene.decode(self.character.scene)
        self.facts, self.arrays = scene.facts, scene.arrays
        self.diagonal = self.facts["diagonal"]
        self.listed = {"name": self.character.name, "kinds": [kind.word for kind in FRAME_KINDS]}
        """What is told of the character."""
        self.kinds = set()
        """Kinds of frames that are subscribed to."""
        self.sent = {}
        """Sent frames by sequence number."""
        self.scenes = 0
        """How often the scene was asked for."""
        self.is_playing = False
        """Whether it calls `make` 30 times per second."""
        self.make = self.send_next
        """Sends something: by default its frames, over and over."""
        self._frames, self._queue, self._ended = frames, [], False
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.XPUB)
        self._socket.heartbeat_ivl = 1000  # libzmq is heard even while this thread gets no time
        self.port = self._socket.bind_to_random_port("tcp://127.0.0.1")
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def next(self, count):
        """Return so many frames, evenly spaced, with numbers and times that follow those before."""
        first = len(self.sent) + 1
        picked = [self._frames[k * len(self._frames) // count] for k in range(count)]
        return [replace(each, sequence=first + k, time=(first + k) / FPS) for k, each in enumerate(picked)]

    def send(self, *frames):
        self.sent |= {frame.sequence: frame for frame in frames}
        self._queue += [lambda kind, frame=frame: encode(kind, frame, 0) for frame in frames]

    def send_controls(self, payload, revision=None):
        """Send a frame with numbers of the test's own, with the next number and time."""
        number = len(self.sent) + 1
        self.sent[number] = None
        name = f"{self.character.name}/controls"
        header = {"revision": revision or self.character.revision, "sequence": number, "time": number / FPS}
        self._queue.append(lambda _kind: message(name, Kind.CONTROLS, payload, **header))

    def send_next(self):
        number = len(self.sent) + 1
        self.send(replace(self._frames[number % len(self._frames)], sequence=number, time=number / FPS))

    def _serve(self):
        told = due = 0.0
        while not self._ended:
            if self._socket.poll(5):
                self._take(self._socket.recv())
                told = 0.0
            elif time.monotonic() > told + 1:  # a follower treats silence as a lost connection
                told = time.monotonic()
                self._publish("service/characters", Kind.CHARACTERS, write_json([self.listed]))
            is_asked = self.kinds and (self.scenes > 0 or "digest" in self.listed)
            if self.is_playing and is_asked and time.monotonic() >= due:
                self.make()
                due = max(due, time.monotonic() - 0.1) + 1 / FPS
            while self._queue and is_asked:
                made = self._queue.pop(0)
                for kind in self.kinds:
                    self._socket.send(made(kind))

    def _take(self, request):
        name, _, word = request[1:].rstrip(b"\0").decode().partition("/")
        if name == self.character.name and WORDS.get(word) in FRAME_KINDS:
            (self.kinds.add if request[0] else self.kinds.discard)(WORDS[word])
        elif request[0] and (name, word) == (self.character.name, "performer"):
            performer = {"state": STATES.index(self._frames[0].state), "user": self._frames[0].user}
            self._publish(f"{name}/{word}", Kind.PERFORMER, **performer)
        elif request[0] and word.startswith("scene/"):
            self.scenes += 1
            self._publish(f"{name}/{word}", Kind.SCENE, self.character.scene, revision=self.character.revision)

    def _publish(self, *arguments, **header):
        self._socket.send(message(*arguments, **header))

    def close(self):
        self._ended = True
        self._thread.join()
        self._context.destroy(linger=0)


def message(topic, kind, payload=b"{}", **header):
    return join(topic_field(topic), Header(kind=kind, length=len(payload), **header), payload)
