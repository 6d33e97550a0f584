using System;
using System.Collections.Generic;
using System.Text;
using System.Threading;

namespace Puppetline
{
    /// <summary>How a follower stands with the service.</summary>
    public enum FollowState
    {
        /// <summary>There is no connection just now; it is tried again each second.</summary>
        Offline,

        /// <summary>A connection is being made.</summary>
        Connecting,

        /// <summary>It is there.</summary>
        Connected,

        /// <summary>The service does not let this client in. It is not tried again: make another follower.</summary>
        Refused,
    }

    /// <summary>
    /// Follows a character of a service, on a thread of its own: connects and connects again, gets the scene, and keeps the
    /// frames that come until they are taken. Nothing here waits for the network but that thread.
    /// </summary>
    public sealed class Follower : IDisposable
    {
        /// <summary>Bytes of the largest message that is taken: a scene of more than a million vertices.</summary>
        public const int LargestMessage = 256 << 20;

        /// <summary>Milliseconds between two tries.</summary>
        const int RetryPause = 1000;

        /// <summary>Seconds in which nothing may come; the status comes each second.</summary>
        const double Silence = 6;

        /// <summary>Seconds between two requests for a scene: the shortest, which is doubled each time, and the longest.</summary>
        const double ShortestPause = 1, LongestPause = 16;

        /// <summary>Milliseconds that the thread sleeps before it looks whether it is to end.</summary>
        const int Nap = 100;

        const string StatusTopic = "service/status", CharactersTopic = "service/characters";

        readonly string host, token, wanted;
        readonly int port;
        readonly Kind kind;
        readonly ManualResetEvent ended = new ManualResetEvent(false);
        readonly Queue<Frame> frames = new Queue<Frame>();

        // what the thread tells others; references change whole
        volatile int state = (int)FollowState.Connecting;
        volatile string reason = "";
        volatile Scene scene;
        volatile Json status = Json.Null;
        volatile string character;

        // the thread's own
        ZmtpConnection connection;
        string sceneTopic, frameTopic;
        byte[] sceneTopicBytes, frameTopicBytes;
        Scene current;
        ulong sequence;
        double asked, pause;

        /// <summary>Begin to follow.</summary>
        /// <param name="host">A name or an address.</param>
        /// <param name="port">The stream's port, 7400 as a rule.</param>
        /// <param name="token">The service's token; null or empty if it has none.</param>
        /// <param name="character">Which character; null or empty for the first one.</param>
        /// <param name="kind">As what: controls, morphs, vertices or vertices16.</param>
        public Follower(string host, int port, string token, string character, Kind kind)
        {
            if (kind < Kind.Controls || kind > Kind.Vertices16)
            {
                throw new ArgumentException("a character is followed by controls, morphs, vertices or vertices16, not by " + kind);
            }
            this.host = host;
            this.port = port;
            this.token = token;
            this.kind = kind;
            wanted = character ?? "";
            new Thread(Run) { IsBackground = true, Name = "Puppetline " + host + ":" + port }.Start();
        }

        /// <summary>How it stands.</summary>
        public FollowState State => (FollowState)state;

        /// <summary>What is wrong, for people; empty if nothing is.</summary>
        public string Reason => reason;

        /// <summary>The character that is followed; null before one is known.</summary>
        public string Character => character;

        /// <summary>The newest scene; null before one has come. It stays when the connection is lost.</summary>
        public Scene Scene => scene;

        /// <summary>The newest status of the service (docs/running.md); <see cref="Json.Null"/> before one has come.</summary>
        public Json Status => status;

        /// <summary>Where frames go that are not needed any more.</summary>
        public FramePool Pool { get; } = new FramePool();

        /// <summary>Take the oldest frame that has come and was not taken.</summary>
        /// <returns>False if there is none.</returns>
        public bool TryTake(out Frame frame)
        {
            lock (frames)
            {
                frame = frames.Count > 0 ? frames.Dequeue() : null;
            }
            return frame != null;
        }

        /// <summary>End it; the thread goes by itself.</summary>
        public void Dispose()
        {
            ended.Set();
        }

        void Run()
        {
            while (!ended.WaitOne(0))
            {
                try
                {
                    Tell(FollowState.Connecting, reason);
                    connection = ZmtpConnection.Open(host, port, "SUB", token, LargestMessage);
                    Tell(FollowState.Connected, "");
                    Begin();
                    Listen();
                }
                catch (RefusedException fault)
                {
                    Tell(FollowState.Refused, fault.Message);
                    return;
                }
                catch (ZmtpException fault)
                {
                    Tell(FollowState.Offline, fault.Message);
                }
                catch (Exception fault)
                {
                    // whatever it is, a game does not end for it
                    Tell(FollowState.Offline, host + ":" + port + ": " + fault);
                }
                finally
                {
                    connection?.Dispose();
                }
                ended.WaitOne(RetryPause);
            }
        }

        void Tell(FollowState state, string reason)
        {
            this.reason = reason;
            this.state = (int)state;
        }

        void Begin()
        {
            current = null;
            sequence = 0;
            sceneTopic = frameTopic = null;
            sceneTopicBytes = frameTopicBytes = null;
            connection.Subscribe(StatusTopic);
            connection.Subscribe(CharactersTopic);
            if (wanted.Length > 0)
            {
                Choose(wanted);
            }
        }

        void Listen()
        {
            while (!ended.WaitOne(0))
            {
                if (connection.Receive(Nap, out ArraySegment<byte> bytes))
                {
                    Take(bytes);
                }
                else if (Clock.Now > connection.Heard + Silence)
                {
                    throw new ZmtpException(host + ":" + port + " has not said anything for " + Silence + " s");
                }
                if (current == null && sceneTopic != null && Clock.Now > asked + pause)
                {
                    // on a slow network the one that was asked for may still be on its way, and each is sent whole
                    connection.Unsubscribe(sceneTopic);
                    Ask(Math.Min(2 * pause, LongestPause));
                }
            }
        }

        void Ask(double pause)
        {
            connection.Subscribe(sceneTopic);
            asked = Clock.Now;
            this.pause = pause;
        }

        void Choose(string name)
        {
            if (name == character && frameTopic != null)
            {
                // it may have only just come to be there
                pause = ShortestPause;
                return;
            }
            if (frameTopic != null)
            {
                connection.Unsubscribe(frameTopic);
                connection.Unsubscribe(sceneTopic);
            }
            character = name;
            current = null;
            frameTopic = name + "/" + kind.ToString().ToLowerInvariant();
            // under a text that nobody else has, nobody else's requests are answered
            sceneTopic = name + "/scene/" + Guid.NewGuid().ToString("N").Substring(0, 24);
            frameTopicBytes = Encoding.ASCII.GetBytes(frameTopic);
            sceneTopicBytes = Encoding.ASCII.GetBytes(sceneTopic);
            connection.Subscribe(frameTopic);
            Ask(ShortestPause);
        }

        void Take(ArraySegment<byte> bytes)
        {
            byte major = Message.MajorOf(bytes);
            if (major > Message.Major)
            {
                throw new RefusedException(
                    host + ":" + port + " speaks version " + major + " of the protocol, and this client version " + Message.Major + ". Update it.");
            }
            if (!Message.TryParse(bytes, out Message message))
            {
                return;
            }
            if (message.Header.Kind == kind && message.Has(frameTopicBytes))
            {
                TakeFrame(message);
            }
            else if (message.Header.Kind == Kind.Scene && message.Has(sceneTopicBytes))
            {
                TakeScene(message);
            }
            else if (message.Header.Kind == Kind.Characters)
            {
                Look(Read(message));
            }
            else if (message.Header.Kind == Kind.Status)
            {
                status = Read(message);
            }
        }

        static Json Read(Message message)
        {
            try
            {
                return Json.Parse(message.Payload);
            }
            catch (FormatException)
            {
                return Json.Null;
            }
        }

        /// <summary>See which characters there are, and choose.</summary>
        void Look(Json characters)
        {
            if (characters.Kind != JsonKind.List)
            {
                return;
            }
            Json mine = Json.Null;
            var names = new List<string>();
            for (int i = 0; i < characters.Count; i++)
            {
                string name = characters[i]["name"].Text;
                names.Add(name);
                if (name == wanted || wanted.Length == 0 && (name == character || mine.Kind == JsonKind.Null))
                {
                    mine = characters[i];
                }
            }
            if (mine.Kind == JsonKind.Null)
            {
                reason = "no character '" + wanted + "' at " + host + ":" + port + "; there is " + string.Join(", ", names);
                return;
            }
            bool streamed = false;
            for (int i = 0; i < mine["kinds"].Count; i++)
            {
                streamed |= mine["kinds"][i].Text == kind.ToString().ToLowerInvariant();
            }
            reason = streamed ? "" : mine["name"].Text + " is not streamed as " + kind + ": serve it with --morphs, see puppetline bake";
            Choose(mine["name"].Text);
        }

        void TakeScene(Message message)
        {
            if (current != null)
            {
                return;
            }
            try
            {
                current = scene = Scene.Parse(message);
                pause = ShortestPause;
                sequence = 0;
            }
            catch (FormatException fault)
            {
                reason = character + ": " + fault.Message;
            }
        }

        void TakeFrame(Message message)
        {
            if (current == null || message.Header.Revision != current.Revision || message.Header.Sequence <= sequence)
            {
                current = null;
                return;
            }
            sequence = message.Header.Sequence;
            Frame frame = Pool.Rent();
            if (!frame.Read(message) || frame.Count != Expected() || !frame.IsFinite())
            {
                reason = character + ": a frame of " + kind + " that does not fit the character";
                Pool.Return(frame);
                return;
            }
            frame.Scene = current;
            frame.Arrived = connection.Heard;
            Keep(frame);
        }

        int Expected()
        {
            switch (kind)
            {
                case Kind.Controls:
                    return current.ControlCount;
                case Kind.Morphs:
                    return 1 + current.Morphs.Count;
                default:
                    return 6 * current.VertexCount;
            }
        }

        void Keep(Frame frame)
        {
            lock (frames)
            {
                if (frames.Count == Playback.Capacity)
                {
                    Pool.Return(frames.Dequeue());
                }
                frames.Enqueue(frame);
            }
        }
    }
}
