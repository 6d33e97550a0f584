using System;
using System.Collections.Generic;
using System.Threading;

namespace Puppetline.Protocol
{
    /// <summary>
    /// The connection to a service, shared by the followers with the same host, port and token. Its thread connects and
    /// reconnects, subscribes to what the followers need, and gives them scenes and frames. It ends with its last follower.
    /// </summary>
    sealed class SharedConnection
    {
        /// <summary>Time between two attempts to connect, in seconds.</summary>
        const double RetrySeconds = 1;

        /// <summary>Time without a message after which the connection counts as lost, in seconds. The status is sent every second.</summary>
        const double SilenceTimeoutSeconds = 6;

        /// <summary>Maximum time for which the thread waits before it checks the clock and changes of its followers, in milliseconds.</summary>
        const int PollMilliseconds = 100;

        const string StatusTopic = "service/status", CharactersTopic = "service/characters";

        static readonly Dictionary<ValueTuple<string, int, string>, SharedConnection> Joinable =
            new Dictionary<ValueTuple<string, int, string>, SharedConnection>();

        readonly ValueTuple<string, int, string> key;
        readonly string address;
        readonly ManualResetEvent ended = new ManualResetEvent(false);

        // Any thread uses these, with the lock of Joinable.
        readonly List<Follower> followers = new List<Follower>();

        // The thread writes these, and other threads read them. References are replaced atomically.
        volatile int state = (int)FollowState.Connecting;
        volatile string reason = "";
        volatile Json status = Json.Null;

        /// <summary>Whether followers have been added or removed since the thread subscribed for them.</summary>
        volatile bool changed;

        // Only the thread uses these.
        readonly List<FrameStream> streams = new List<FrameStream>();
        readonly List<SceneStream> scenes = new List<SceneStream>();
        ZmtpConnection connection;
        Json characters = Json.Null;

        SharedConnection(ValueTuple<string, int, string> key)
        {
            this.key = key;
            address = key.Item1 + ":" + key.Item2;
        }

        public FollowState State => (FollowState)state;

        public string Reason => reason;

        public Json Status => status;

        public FramePool Pool { get; } = new FramePool();

        /// <summary>Add a follower to the connection of an address and a token, which is opened if there is none.</summary>
        public static SharedConnection Join(string host, int port, string token, Follower follower)
        {
            var key = ValueTuple.Create(host, port, token);
            lock (Joinable)
            {
                if (!Joinable.TryGetValue(key, out SharedConnection shared))
                {
                    shared = Joinable[key] = new SharedConnection(key);
                    new Thread(shared.Run) { IsBackground = true, Name = "Puppetline " + shared.address }.Start();
                }
                shared.followers.Add(follower);
                shared.changed = true;
                return shared;
            }
        }

        public void Leave(Follower follower)
        {
            lock (Joinable)
            {
                followers.Remove(follower);
                changed = true;
                if (followers.Count == 0)
                {
                    Close();
                }
            }
        }

        /// <summary>End the thread. The next follower opens another connection.</summary>
        void Close()
        {
            lock (Joinable)
            {
                ended.Set();
                if (Joinable.TryGetValue(key, out SharedConnection current) && current == this)
                {
                    Joinable.Remove(key);
                }
            }
        }

        void Run()
        {
            while (!ended.WaitOne(0))
            {
                try
                {
                    SetState(FollowState.Connecting, reason);
                    connection = ZmtpConnection.Open(key.Item1, key.Item2, "SUB", key.Item3, Follower.LargestMessage);
                    Begin();
                    SetState(FollowState.Connected, "");
                    ReceiveMessages();
                }
                catch (RefusedException error)
                {
                    SetState(FollowState.Refused, error.Message);
                    Close();
                }
                catch (ZmtpException error)
                {
                    SetState(FollowState.Offline, error.Message);
                }
                catch (Exception error)
                {
                    // No error of this thread may end the game.
                    SetState(FollowState.Offline, address + ": " + error);
                }
                finally
                {
                    connection?.Dispose();
                }
                double next = Clock.Now + RetrySeconds;
                while (Clock.Now < next && !ended.WaitOne(PollMilliseconds))
                {
                }
            }
        }

        void SetState(FollowState state, string reason)
        {
            this.reason = reason;
            this.state = (int)state;
        }

        void Begin()
        {
            streams.Clear();
            scenes.Clear();
            characters = Json.Null;
            connection.Subscribe(StatusTopic);
            connection.Subscribe(CharactersTopic);
            foreach (Follower follower in Subscribe())
            {
                follower.Explain("");
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
                    throw new ZmtpException(address + " has not sent a message for " + SilenceTimeoutSeconds + " s");
                }
                if (changed)
                {
                    Subscribe();
                }
                foreach (SceneStream scene in scenes)
                {
                    scene.RepeatRequest();
                }
            }
        }

        /// <summary>Subscribe to the streams of all followers, and to no others.</summary>
        /// <returns>The followers.</returns>
        Follower[] Subscribe()
        {
            Follower[] now;
            lock (Joinable)
            {
                changed = false;
                now = followers.ToArray();
            }
            streams.ForEach(stream => stream.Followers.Clear());
            foreach (Follower follower in now)
            {
                if (characters.Kind == JsonKind.List)
                {
                    follower.ChooseFrom(characters, address);
                }
                if (follower.Character != null)
                {
                    StreamOf(follower).Add(follower);
                }
            }
            foreach (FrameStream stream in streams.FindAll(each => each.Followers.Count == 0))
            {
                stream.Unsubscribe();
                streams.Remove(stream);
            }
            foreach (SceneStream scene in scenes.FindAll(each => !streams.Exists(stream => stream.Scene == each)))
            {
                scene.Unsubscribe();
                scenes.Remove(scene);
            }
            return now;
        }

        FrameStream StreamOf(Follower follower)
        {
            string character = follower.Character;
            FrameStream found = streams.Find(each => each.Kind == follower.FrameKind && each.Scene.Character == character);
            if (found == null)
            {
                SceneStream scene = scenes.Find(each => each.Character == character);
                if (scene == null)
                {
                    scene = new SceneStream(connection, character);
                    scenes.Add(scene);
                }
                found = new FrameStream(connection, scene, follower.FrameKind);
                streams.Add(found);
            }
            return found;
        }

        void Handle(ArraySegment<byte> bytes)
        {
            byte major = Message.MajorOf(bytes);
            if (major > Message.Major)
            {
                throw new RefusedException(
                    address + " uses version " + major + " of the protocol; this client supports version " + Message.Major + ". Update it.");
            }
            if (!Message.TryParse(bytes, out Message message))
            {
                return;
            }
            switch (message.Header.Kind)
            {
                case Kind.Status:
                    status = Read(message);
                    break;
                case Kind.Characters:
                    TakeCharacters(Read(message));
                    break;
                case Kind.Scene:
                    TakeScene(message);
                    break;
                default:
                    TakeFrame(message);
                    break;
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

        void TakeCharacters(Json list)
        {
            characters = list;
            // A character may have been loaded a moment ago.
            scenes.ForEach(scene => scene.RequestSoon());
            Subscribe();
        }

        void TakeScene(Message message)
        {
            foreach (SceneStream scene in scenes)
            {
                if (scene.Take(message, out string error))
                {
                    foreach (FrameStream stream in streams)
                    {
                        if (stream.Scene == scene)
                        {
                            stream.Restart(error);
                        }
                    }
                }
            }
        }

        void TakeFrame(Message message)
        {
            foreach (FrameStream stream in streams)
            {
                stream.Take(message, Pool);
            }
        }
    }
}
