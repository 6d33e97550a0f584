using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.Globalization;
using System.IO;
using System.Reflection;
using System.Threading;
using Puppetline.Protocol;

/// <summary>Runs the plain core, without any part of Unity, by the commands of the tests.</summary>
static class Core
{
    static int Main(string[] arguments)
    {
        Said.Open();
        int code = Run(arguments);
        Said.End(code);
        return code;
    }

    static int Run(string[] arguments)
    {
        switch (arguments[0])
        {
            case "decode":
                DecodeAll(File.ReadAllBytes(arguments[1]));
                return 0;
            case "evaluate":
                Evaluate(arguments[1], arguments[2]);
                return 0;
            case "json":
                ReadJson();
                return 0;
            case "playback":
                Play(Json.Parse(Console.In.ReadToEnd()));
                return 0;
            case "follow":
                Follow(arguments);
                return 0;
            case "request":
                Request(arguments);
                return 0;
            case "measure":
                Measure(arguments[1], arguments[2]);
                return 0;
            default:
                return 1;
        }
    }

    static Message Load(string path)
    {
        return Message.TryParse(new ArraySegment<byte>(File.ReadAllBytes(path)), out Message message)
            ? message
            : throw new FormatException("no message");
    }

    /// <summary>Decode messages, each after its length in 4 bytes.</summary>
    static void DecodeAll(byte[] bytes)
    {
        for (int at = 0; at < bytes.Length; at += 4 + BitConverter.ToInt32(bytes, at))
        {
            var content = new byte[BitConverter.ToInt32(bytes, at)];
            Buffer.BlockCopy(bytes, at + 4, content, 0, content.Length);
            Decode(new ArraySegment<byte>(content));
        }
    }

    static void Decode(ArraySegment<byte> content)
    {
        if (!Message.TryParse(content, out Message message))
        {
            Said.Line("refused", "message");
            return;
        }
        Header h = message.Header;
        var header = new object[] { (int)h.Kind, (int)h.State, h.User, h.Revision, h.Sequence, h.Time, h.Received, h.Published, h.RootX, h.RootY, h.RootZ };
        try
        {
            Say(message, header);
        }
        catch (FormatException fault)
        {
            Said.Line("refused", fault.Message);
        }
    }

    static void Say(Message message, object[] header)
    {
        if (message.Header.Kind == Kind.Scene)
        {
            Scene s = Scene.Parse(message);
            Said.Line(
                "topic", message.Topic, "header", header, "description", s.Description,
                "counts", new object[] { s.Revision, s.VertexCount, s.TriangleCount, s.FieldCount, s.IsolineCount, s.Parts.Count, s.Morphs.Count },
                "diagonal", s.Diagonal, "weights", Said.Bytes(s.Weights), "triangles", Said.Bytes(s.Triangles),
                "positions", Said.Bytes(s.Positions), "normals", Said.Bytes(s.Normals), "ladder", Said.Bytes(s.IsolineCoordinates),
                "slopes", Said.Bytes(s.Slopes), "uv", Said.Bytes(s.Uv), "colors", Said.Bytes(s.Colors));
        }
        else if (!Enum.IsDefined(typeof(Kind), message.Header.Kind))
        {
            Said.Line("topic", message.Topic, "header", header, "values", "");
        }
        else if (message.Header.Kind >= Kind.Performer && message.Header.Kind != Kind.Bones)
        {
            Said.Line("topic", message.Topic, "header", header, "json", Json.Parse(message.Payload));
        }
        else
        {
            var frame = new Frame();
            bool read = frame.Read(message);
            Said.Line(
                "topic", message.Topic, "header", header, "read", read, "finite", read && frame.IsFinite(),
                "values", Said.Bytes(frame.Values, read ? frame.Count : 0));
        }
    }

    static void Evaluate(string sceneFile, string controlsFile)
    {
        Scene scene = Scene.Parse(Load(sceneFile));
        var frame = new Frame();
        frame.Read(Load(controlsFile));
        var rest = new RestPose(scene);
        rest.Move(frame.Targets);
        var deformation = new Deformation(scene, rest.Positions);
        var vertices = new SurfaceVertex[scene.VertexCount];
        foreach (NormalsBy normals in new[] { NormalsBy.Slopes, NormalsBy.Cofactors })
        {
            foreach (Axes axes in new[] { Axes.File, Axes.Unity })
            {
                Box box = deformation.Evaluate(frame.Values, normals, axes, vertices);
                Box around = new ControlBounds(scene).Of(frame.Values, axes);
                Said.Line("normals", normals, "axes", axes, "vertices", Said.Bytes(vertices), "box", Said.Of(box), "around", Said.Of(around));
            }
        }
        Said.Line("turned", Said.Bytes(Surface.TurnedOver(scene.Triangles)));
    }

    static void ReadJson()
    {
        for (string line = Console.In.ReadLine(); line != null; line = Console.In.ReadLine())
        {
            try
            {
                Said.Line("value", Json.Parse(new ArraySegment<byte>(Convert.FromBase64String(line))));
            }
            catch (FormatException fault)
            {
                Said.Line("refused", fault.Message);
            }
        }
    }

    /// <summary>Play back frames. A step is [time, arrived, value] of a frame, or the time of an update.</summary>
    static void Play(Json told)
    {
        var scene = Scene.Parse(Load(told["scene"].Text));
        var playback = new Playback(told["delay"].Number, new FramePool());
        for (int i = 0; i < told["steps"].Count; i++)
        {
            Json step = told["steps"][i];
            if (step.Kind == JsonKind.List)
            {
                var frame = new Frame { Scene = scene, Arrived = step[1].Number, Values = new[] { (float)step[2].Number }, Count = 1 };
                frame.Header.Time = step[0].Number;
                playback.Add(frame);
                continue;
            }
            bool changed = playback.Update(step.Number);
            Said.Line("changed", changed, "value", playback.Shown == null ? null : (object)playback.Shown.Values[0]);
        }
    }

    /// <summary>
    /// Follow until standard input ends, and print received data. A line of input stops the clock, and advances it by so
    /// many seconds.
    /// </summary>
    static void Follow(string[] arguments)
    {
        var kind = (Kind)Enum.Parse(typeof(Kind), arguments[5], true);
        using (var follower = new Follower(arguments[1], int.Parse(arguments[2]), arguments[3], arguments[4], kind))
        {
            string said = null;
            Scene scene = null;
            Deformation deformation = null;
            SurfaceVertex[] vertices = null;
            int tries = 0;
            var reading = new Thread(() => TurnClock(follower, ref tries));
            reading.Start();
            while (reading.IsAlive)
            {
                // once more after each try to connect, in which the state may have changed and changed back
                string state = Volatile.Read(ref tries) + " " + follower.State + " " + follower.Reason;
                if (state != said)
                {
                    Said.Line("state", follower.State, "reason", follower.Reason);
                    said = state;
                }
                while (reading.IsAlive && follower.TryTake(out Frame frame))
                {
                    if (frame.Scene != scene)
                    {
                        scene = frame.Scene;
                        deformation = new Deformation(scene);
                        vertices = new SurfaceVertex[scene.VertexCount];
                        Said.Line("scene", scene.Revision, "character", follower.Character, "vertices", scene.VertexCount, "diagonal", scene.Diagonal);
                    }
                    SayFrame(kind, frame, deformation, vertices);
                    follower.Pool.Return(frame);
                }
                Thread.Sleep(2);
            }
            Said.Line("status", follower.Status);
        }
    }

    static void SayFrame(Kind kind, Frame frame, Deformation deformation, SurfaceVertex[] vertices)
    {
        string values;
        if (kind == Kind.Morphs)
        {
            values = Said.Bytes(frame.Values, frame.Count);
        }
        else
        {
            if (kind == Kind.Controls)
            {
                deformation.Evaluate(frame.Values, NormalsBy.Slopes, Axes.File, vertices);
            }
            else
            {
                Surface.Write(frame.Values, frame.Values, 3 * vertices.Length, Axes.File, vertices);
            }
            values = Said.Bytes(vertices);
        }
        Said.Line("frame", frame.Header.Sequence, "time", frame.Header.Time, "user", frame.Header.User, "values", values);
    }

    static void TurnClock(Follower follower, ref int tries)
    {
        double given = 0;
        int looks = 0;
        Func<double> source = () =>
        {
            Interlocked.Increment(ref looks);
            return Volatile.Read(ref given);
        };
        Func<int, Func<bool>, int> waitForLooks = (count, goesOn) =>
        {
            for (int wanted = looks + count; looks < wanted && goesOn();)
            {
                Thread.Sleep(1);
            }
            return looks;
        };
        for (string line = Console.In.ReadLine(); line != null; line = Console.In.ReadLine())
        {
            given = looks == 0 ? Clock.Now : given;
            SetClock(source);
            // The thread of the connection looks twice as soon as it waits for a time, and once more at most before it acts.
            waitForLooks(2, () => follower.State != FollowState.Connecting && follower.State != FollowState.Refused);
            FollowState before = follower.State;
            Volatile.Write(ref given, given + double.Parse(line, CultureInfo.InvariantCulture));
            // until it has seen that time, or has tried to connect
            waitForLooks(3, () => before == FollowState.Connected
                ? follower.State == FollowState.Connected
                : before == FollowState.Offline && follower.State <= FollowState.Connecting);
            Said.Line("turned", line);
            tries += before == FollowState.Offline ? 1 : 0;
        }
    }

    static void SetClock(Func<double> source)
    {
        typeof(Clock).GetProperty("Source", BindingFlags.Static | BindingFlags.NonPublic).SetValue(null, source);
    }

    /// <summary>
    /// Send the requests from standard input together, one JSON object per line, and print the replies. The clock stands
    /// still, so that no reply comes too late.
    /// </summary>
    static void Request(string[] arguments)
    {
        SetClock(() => 0);
        using (var client = new ControlClient(arguments[1], int.Parse(arguments[2]), arguments[3]))
        {
            int open = 0;
            Thread reading = null;
            var asked = new Queue<Json>();
            reading = new Thread(() =>
            {
                for (string line = Console.In.ReadLine(); line != null; line = Console.In.ReadLine())
                {
                    lock (asked)
                    {
                        asked.Enqueue(Json.Parse(line));
                    }
                }
            });
            reading.Start();
            while (reading.IsAlive || open > 0 || asked.Count > 0)
            {
                lock (asked)
                {
                    while (asked.Count > 0)
                    {
                        open++;
                        Json next = asked.Dequeue();
                        client.Request(next["do"].Text, Arguments(next), reply =>
                        {
                            Said.Line("reply", reply);
                            open--;
                        });
                    }
                }
                client.Poll();
                Thread.Sleep(2);
            }
        }
    }

    static Dictionary<string, object> Arguments(Json asked)
    {
        var values = new Dictionary<string, object>();
        foreach (string name in asked.Names)
        {
            Json value = asked[name];
            values[name] = value.Kind == JsonKind.Null ? null
                : value.Kind == JsonKind.Number ? value.Number
                : value.Kind == JsonKind.Boolean ? value.True
                : (object)value.Text;
        }
        values.Remove("do");
        return values;
    }

    /// <summary>Measure the cost of a frame: the evaluation time in milliseconds without other load, and the allocated bytes.</summary>
    static void Measure(string sceneFile, string controlsFile)
    {
        const int Frames = 200;
        Scene scene = Scene.Parse(Load(sceneFile));
        Message controls = Load(controlsFile);
        var pool = new FramePool();
        var playback = new Playback(0.05, pool);
        var deformation = new Deformation(scene);
        var bounds = new ControlBounds(scene);
        var vertices = new SurfaceVertex[scene.VertexCount];
        foreach (string what in new[] { "nothing", "slopes", "cofactors", "bounds" })
        {
            double best = double.MaxValue;
            long before = 0;
            for (int i = -20; i < Frames; i++)
            {
                if (i == 0)
                {
                    best = double.MaxValue;
                    before = GC.GetAllocatedBytesForCurrentThread();
                }
                Frame frame = pool.Rent();
                frame.Read(controls);
                frame.Header.Time = (i + 20) / 30.0;
                frame.Arrived = 100 + (i + 20) / 30.0;
                frame.Scene = scene;
                playback.Add(frame);
                playback.Update(frame.Arrived + 0.01);
                long start = Stopwatch.GetTimestamp();
                switch (what)
                {
                    case "slopes":
                        deformation.Evaluate(playback.Shown.Values, NormalsBy.Slopes, Axes.Unity, vertices);
                        break;
                    case "cofactors":
                        deformation.Evaluate(playback.Shown.Values, NormalsBy.Cofactors, Axes.Unity, vertices);
                        break;
                    case "bounds":
                        bounds.Of(playback.Shown.Values, Axes.Unity);
                        break;
                }
                best = Math.Min(best, (Stopwatch.GetTimestamp() - start) / (double)Stopwatch.Frequency);
            }
            Said.Line(
                "what", what, "vertices", scene.VertexCount, "ms", 1000 * best,
                "bytes", (GC.GetAllocatedBytesForCurrentThread() - before) / (double)Frames);
            playback.Clear();
        }
    }
}
