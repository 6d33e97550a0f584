using System;
using System.Collections.Generic;
using System.Text;
using System.Threading;

namespace Puppetline.Protocol
{
    /// <summary>State of a follower's connection to the service.</summary>
    public enum FollowState
    {
        /// <summary>Not connected. The follower retries every second.</summary>
        Offline,

        /// <summary>Connecting to the service.</summary>
        Connecting,

        /// <summary>Connected to the service.</summary>
        Connected,

        /// <summary>The service refuses the connection. This follower does not retry; create a new one.</summary>
        Refused,
    }

    /// <summary>
    /// Follows a character of a service on its own thread. It connects and reconnects, requests the scene, and queues
    /// frames until they are taken. Only its thread waits for the network.
    /// </summary>
    public sealed class Follower : IDisposable
    {
        /// <summary>Maximum size of a message, in bytes, enough for a scene of more than a million vertices.</summary>
        public const int LargestMessage = 256 << 20;

        /// <summary>Time between two attempts to connect, in milliseconds.</summary>
        const int RetryMilliseconds = 1000;

        /// <summary>Time without a message after which the connection counts as lost, in seconds. The status is sent every second.</summary>
        const double SilenceTimeoutSeconds = 6;

        /// <summary>Minimum time between two requests of a scene, which doubles each time, and its maximum, in seconds.</summary>
        const double MinRequestSeconds = 1, MaxRequestSeconds = 16;

        /// <summary>Maximum time for which the thread waits before it checks whether to end, in milliseconds.</summary>
        const int PollMilliseconds = 100;

        const string StatusTopic = "service/status", CharactersTopic = "service/characters";

        readonly string host, token, wanted;
        readonly int port;
        readonly Kind kind;
        readonly ManualResetEvent ended = new ManualResetEvent(false);
        readonly Queue<Frame> frames = new Queue<Frame>();

        // The thread writes these and other threads read them. References are replaced atomically.
        volatile int state = (int)FollowState.Connecting;
        volatile string reason = "";
        volatile Scene scene;
        volatile Json status = Json.Null;
        volatile string character;

        // Only the thread uses these.
        ZmtpConnection connection;
        string sceneTopic, frameTopic;
        byte[] sceneTopicBytes, frameTopicBytes;
        Scene current;
        ulong sequence;
        double requested, pause;

        /// <summary>Begin to follow a character.</summary>
        /// <param name="host">A host name or an address.</param>
        /// <param name="port">The stream's port, usually 7400.</param>
        /// <param name="token">The service's token; null or empty if it has none.</param>
        /// <param name="character">Name of the character; null or empty for the first one.</param>
        /// <param name="kind">Kind of frames: controls, morphs, vertices or vertices16.</param>
        public Follower(string host, int port, string token, string character, Kind kind)
        {
            if (kind < Kind.Controls || kind > Kind.Vertices16)
            {
                throw new ArgumentException("frames of a character have the kind controls, morphs, vertices or vertices16, not " + kind);
            }
            this.host = host;
            this.port = port;
            this.token = token;
            this.kind = kind;
            wanted = character ?? "";
            new Thread(Run) { IsBackground = true, Name = "Puppetline " + host + ":" + port }.Start();
        }

        /// <summary>State of the connection.</summary>
        public FollowState State => (FollowState)state;

        /// <summary>Description of an error for the user; empty if there is none.</summary>
        public string Reason => reason;

        /// <summary>Name of the followed character; null before it is known.</summary>
        public string Character => character;

        /// <summary>The newest scene; null before the first one. It stays when the connection is lost.</summary>
        public Scene Scene => scene;

        /// <summary>The newest status of the service (docs/running.md); <see cref="Json.Null"/> before the first one.</summary>
        public Json Status => status;

        /// <summary>Pool for frames that are not used any more.</summary>
        public FramePool Pool { get; } = new FramePool();

        /// <summary>Handle the oldest frame from the queue.</summary>
        /// <returns>False if there is none.</returns>
        public bool TryTake(out Frame frame)
        {
            lock (frames)
            {
                frame = frames.Count > 0 ? frames.Dequeue() : null;
            }
            return frame != null;
        }

        /// <summary>Stop following. The thread ends without being waited for.</summary>
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
                    SetState(FollowState.Connecting, reason);
                    connection = ZmtpConnection.Open(host, port, "SUB", token, LargestMessage);
                    SetState(FollowState.Connected, "");
                    Begin();
                    ReceiveMessages();
                }
                catch (RefusedException error)
                {
                    SetState(FollowState.Refused, error.Message);
                    return;
                }
                catch (ZmtpException error)
                {
                    SetState(FollowState.Offline, error.Message);
                }
                catch (Exception error)
                {
                    // No error of this thread may end the game.
                    SetState(FollowState.Offline, host + ":" + port + ": " + error);
                }
                finally
                {
                    connection?.Dispose();
                }
                ended.WaitOne(RetryMilliseconds);
            }
        }

        void SetState(FollowState state, string reason)
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

        void ReceiveMessages()
        {
            while (!ended.WaitOne(0))
            {
                if (connection.Receive(PollMilliseconds, out ArraySegment<byte> bytes))
                {
                    Handle(bytes);
                }
                else if (Clock.Now > connection.Heard + SilenceTimeoutSeconds)
                {
                    throw new ZmtpException(host + ":" + port + " has not sent a message for " + SilenceTimeoutSeconds + " s");
                }
                if (current == null && sceneTopic != null && Clock.Now > requested + pause)
                {
                    // On a slow network, the requested scene may still be arriving, and each request queues a whole scene.
                    connection.Unsubscribe(sceneTopic);
                    RequestScene(Math.Min(2 * pause, MaxRequestSeconds));
                }
            }
        }

        void RequestScene(double pause)
        {
            connection.Subscribe(sceneTopic);
            requested = Clock.Now;
            this.pause = pause;
        }

        void Choose(string name)
        {
            if (name == character && frameTopic != null)
            {
                // The character may have been loaded a moment ago.
                pause = MinRequestSeconds;
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
            // With a unique topic, the requests of other clients are not answered here.
            sceneTopic = name + "/scene/" + Guid.NewGuid().ToString("N").Substring(0, 24);
            frameTopicBytes = Encoding.ASCII.GetBytes(frameTopic);
            sceneTopicBytes = Encoding.ASCII.GetBytes(sceneTopic);
            connection.Subscribe(frameTopic);
            RequestScene(MinRequestSeconds);
        }

        void Handle(ArraySegment<byte> bytes)
        {
            byte major = Message.MajorOf(bytes);
            if (major > Message.Major)
            {
                throw new RefusedException(
                    host + ":" + port + " uses version " + major + " of the protocol; this client supports version " + Message.Major + ". Update it.");
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
                ChooseFrom(Read(message));
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

        /// <summary>Choose a character from the list of characters.</summary>
        void ChooseFrom(Json characters)
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
                reason = host + ":" + port + " has no character '" + wanted + "'. Its characters are: " + string.Join(", ", names) + ".";
                return;
            }
            bool streamed = false;
            for (int i = 0; i < mine["kinds"].Count; i++)
            {
                streamed |= mine["kinds"][i].Text == kind.ToString().ToLowerInvariant();
            }
            reason = streamed ? "" : mine["name"].Text + " is not streamed as " + kind + ". Start the service with --morphs and the .glb from puppetline bake.";
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
                pause = MinRequestSeconds;
                sequence = 0;
            }
            catch (FormatException error)
            {
                reason = character + ": " + error.Message;
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
            if (!frame.Read(message) || frame.Count != ExpectedCount() || !frame.IsFinite())
            {
                reason = character + ": received a frame of " + kind + " that does not match the scene";
                Pool.Return(frame);
                return;
            }
            frame.Scene = current;
            frame.Arrived = connection.Heard;
            Enqueue(frame);
        }

        int ExpectedCount()
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

        void Enqueue(Frame frame)
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
