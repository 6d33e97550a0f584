"""A service in the process and thread of a test, on the clock that the test is given."""

import json
import math
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import partial
from select import select

from engine_bridge.cli import serve
from engine_bridge.service.background_jobs import Jobs
from engine_bridge.service.commands import commands
from engine_bridge.service.loading import service_file
from engine_bridge.service.monitoring.status import OutputStatus
from engine_bridge.service.outputs.output import Output
from engine_bridge.service.protocol.header import subscription
from engine_bridge.service.service import Service

from .client import Client


class AtOnce(Executor):
    """Runs what is submitted before it returns."""

    def submit(self, work, /, *arguments, **more):
        done = Future()
        try:
            done.set_result(work(*arguments, **more))
        except Exception as error:
            done.set_exception(error)
        return done


class Stopping(Output):
    """Keeps all frames, and has the loop turn at a moment."""

    statistics = OutputStatus("test", "", 0, 0, None, 0)

    def __init__(self):
        self.frames, self.end = [], math.inf

    def offer(self, frame):
        self.frames.append(frame)

    def due(self):
        return self.end

    def close(self):
        pass


class InProcess:
    """What `puppetline serve` runs, turn by turn.

    Attributes
    ----------
    service : Service
    frames : list of Frame
        All frames so far, with the time of the performer's data in `received`.
    shown : list of Status
    """

    def __init__(self, clock, arguments):
        with serve.serve.make_context("serve", [*map(str, arguments)]) as context:
            given = context.params.items()
            options = {name: value for name, value in given if not name.startswith(("studio", "status", "log_"))}
            config = options.pop("config")
            settings, folder = serve._service_file(config, options)
        read_settings = None if config is None else partial(service_file.load, config)
        self.clock, self.shown, self._clients, self._is_closed, self._run_from = clock, [], [], False, 0
        jobs = Jobs(lambda *_: AtOnce())
        self.service = Service(settings, folder, commands, self.shown.append, read_settings, jobs)
        self._stopping = Stopping()
        self.service._outputs.append(self._stopping)
        self.frames = self._stopping.frames

    def until(self, condition, seconds=60.0):
        """Let time pass until a function returns something true, and return that; fail after so many seconds."""
        end = self._stopping.end = self.clock.now() + seconds
        stood = 0
        while not (found := condition()):
            assert self.clock.now() < end, "it has not come"
            before = self.clock.now()
            self.service.turn()
            stood = stood + 1 if self.clock.now() == before else 0
            assert stood < 100, "the loop does not wait"
        self._stopping.end = math.inf
        return found

    def run(self, seconds):
        """Let time pass; return the frames."""
        self._run_from, end = len(self.frames), self.clock.now() + seconds
        self.until(lambda: self.clock.now() >= end, seconds)
        return self.frames[self._run_from :]

    def next_frame(self):
        """Let time pass until the next frame, and return that."""
        count = len(self.frames)
        self.until(lambda: len(self.frames) > count)
        return self.frames[-1]

    def wait(self, condition):
        """Turn the loop while the clock stands, until what others do in their own time has happened."""
        with self.clock.standing():
            while not (found := condition()):
                self.service.turn()
        return found

    def beside(self, call, *arguments, **more):
        """Call in a thread what waits for the service, and turn the loop meanwhile, while the clock stands."""
        with ThreadPoolExecutor() as threads:
            called = threads.submit(call, *arguments, **more)
            self.wait(called.done)
        return called.result()

    def client(self, *topics):
        """Connect a client, and wait until its subscriptions have come."""
        client = Client(self.service.stream[0])
        self._clients.append(client)
        streams = self.service._outputs[0]._streams.values()
        for topic, prefix in zip(topics, map(subscription, topics), strict=True):
            held = [stream.subscriptions._held[prefix] for stream in streams]
            client.socket.subscribe(prefix)
            if topic.count("/") == 1:  # a scene of the client's own is answered, and not held
                self.wait(lambda h=held, p=prefix: h != [each.subscriptions._held[p] for each in streams])
        return client

    def kinds(self, output=0):
        """Return the kinds of the first character's frames that clients of an output subscribe to."""
        streams = self.service._outputs[output]._streams.values()
        return {kind for stream in streams for kind in stream.kinds_of(self.service.names[0])}

    def heard(self, client, wanted=lambda _: True, kind=None):
        """Return the messages of a kind that come to a client while the clock stands, up to one that is wanted."""
        received = []

        def came():
            received.extend(each for each in client.pending() if kind in (None, each.topic.rpartition("/")[2]))
            return any(map(wanted, received))

        self.wait(came)
        return received

    def request(self, do, **arguments):
        """Make a request; return the list that its reply will be added to."""
        replies = []
        self.service.dispatcher.take(json.dumps({"do": do, **arguments}).encode(), replies.append, "json")
        return replies

    def ask(self, do, **arguments):
        """Make a request; return the result, or the error as a dict."""
        replies = self.request(do, **arguments)
        reply = json.loads(self.until(lambda: replies)[0])
        return reply["result"] if reply["ok"] else reply["error"]

    def stage(self):
        """Return the status of the first stage."""
        return self.ask("describe")["status"]["stages"][0]

    def perform(self, sender, frames, user=1, interval=1 / 30):
        """Have frames sent from now on at an interval, each of which has arrived when it has been sent."""

        def send(frame):
            if not self._is_closed:
                sender.send(frame, user)
                select([self.service.runners[0].source.fileno()], [], [])

        for number, frame in enumerate(frames):
            self.clock.call_at(self.clock.now() + number * interval, partial(send, frame))

    def of(self, name):
        """Return the frames of a character in the last `run`."""
        return [frame for frame in self.frames[self._run_from :] if frame.character.name == name]

    @property
    def runner(self):
        """The first stage."""
        return self.service.runners[0]

    def player(self, name):
        """Return the player of a character."""
        return self.service.find(name)[1]

    def close(self):
        self._is_closed = True
        for client in self._clients:
            client.close()
        self._clients.clear()
        self.service.close()
