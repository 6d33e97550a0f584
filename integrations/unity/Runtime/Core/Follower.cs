using System;
using System.Collections.Generic;

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
    /// Follows a character of a service. It queues frames until they are taken. All followers with the same host, port and
    /// token share one connection, whose thread does the network work, and followers of the same character share its scene.
    /// </summary>
    public sealed class Follower : IDisposable
    {
        /// <summary>Maximum size of a message, in bytes, enough for a scene of more than a million vertices.</summary>
        public const int LargestMessage = 256 << 20;

        readonly SharedConnection connection;
        readonly string wanted;
        readonly Queue<Frame> frames = new Queue<Frame>();

        // The connection's thread writes these and other threads read them. References are replaced atomically.
        volatile string reason = "";
        volatile Scene scene;
        volatile string character;

        /// <summary>Begin to follow a character.</summary>
        /// <param name="host">A host name or an address.</param>
        /// <param name="port">The stream's port, usually 7400.</param>
        /// <param name="token">The service's token; null or empty if it has none.</param>
        /// <param name="character">Name of the character; null or empty for the first one.</param>
        /// <param name="kind">Kind of frames: controls, morphs, vertices, vertices16 or bones.</param>
        public Follower(string host, int port, string token, string character, Kind kind)
        {
            if (kind != Kind.Bones && (kind < Kind.Controls || kind > Kind.Vertices16))
            {
                throw new ArgumentException("frames of a character have the kind controls, morphs, vertices or vertices16, not " + kind);
            }
            FrameKind = kind;
            wanted = character ?? "";
            this.character = wanted.Length > 0 ? wanted : null;
            connection = SharedConnection.Join(host, port, token ?? "", this);
        }

        /// <summary>State of the connection.</summary>
        public FollowState State => connection.State;

        /// <summary>Description of an error for the user; empty if there is none.</summary>
        public string Reason => connection.Reason.Length > 0 ? connection.Reason : reason;

        /// <summary>Name of the followed character; null before it is known.</summary>
        public string Character => character;

        /// <summary>The newest scene; null before the first one. It stays when the connection is lost.</summary>
        public Scene Scene => scene;

        /// <summary>The newest status of the service (docs/running.md); <see cref="Json.Null"/> before the first one.</summary>
        public Json Status => connection.Status;

        /// <summary>Pool for frames that are not used any more, shared by the followers of the connection.</summary>
        public FramePool Pool => connection.Pool;

        internal Kind FrameKind { get; }

        /// <summary>Take the oldest frame from the queue. Other followers can hold it too, so it must not be changed.</summary>
        /// <returns>False if there is none.</returns>
        public bool TryTake(out Frame frame)
        {
            lock (frames)
            {
                frame = frames.Count > 0 ? frames.Dequeue() : null;
            }
            return frame != null;
        }

        /// <summary>Stop following. Disposing the last follower also ends the connection, which is not waited for.</summary>
        public void Dispose()
        {
            connection.Leave(this);
        }

        /// <summary>Choose the character from the list of characters.</summary>
        internal void ChooseFrom(Json characters, string address)
        {
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
                reason = address + " has no character '" + wanted + "'. Its characters are: " + string.Join(", ", names) + ".";
                return;
            }
            bool streamed = false;
            for (int i = 0; i < mine["kinds"].Count; i++)
            {
                streamed |= mine["kinds"][i].Text == FrameKind.ToString().ToLowerInvariant();
            }
            string remedy = FrameKind == Kind.Bones ? "Its puppet file needs a [[limb]]." : "Start the service with --morphs and the .glb from puppetline bake.";
            reason = streamed ? "" : mine["name"].Text + " is not streamed as " + FrameKind + ". " + remedy;
            character = mine["name"].Text;
        }

        internal void Explain(string reason)
        {
            this.reason = reason;
        }

        internal void Load(Scene loaded)
        {
            scene = loaded;
        }

        internal void Enqueue(Frame frame)
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
