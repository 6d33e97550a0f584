using System.Collections.Generic;
using System.Text;

namespace Puppetline.Protocol
{
    /// <summary>
    /// Gives the frames of one character and kind to all followers of a shared connection that want them. Only the
    /// connection's thread uses it.
    /// </summary>
    sealed class FrameStream
    {
        readonly ZmtpConnection connection;
        readonly string topic;
        readonly byte[] topicBytes;
        ulong sequence;

        public FrameStream(ZmtpConnection connection, SceneStream scene, Kind kind)
        {
            this.connection = connection;
            Scene = scene;
            Kind = kind;
            topic = scene.Character + "/" + kind.ToString().ToLowerInvariant();
            topicBytes = Encoding.ASCII.GetBytes(topic);
            connection.Subscribe(topic);
        }

        public SceneStream Scene { get; }

        public Kind Kind { get; }

        public List<Follower> Followers { get; } = new List<Follower>();

        /// <summary>Add a follower. It gets the scene immediately if that has arrived.</summary>
        public void Add(Follower follower)
        {
            Followers.Add(follower);
            if (Scene.Current != null)
            {
                follower.Load(Scene.Current);
            }
        }

        public void Unsubscribe()
        {
            connection.Unsubscribe(topic);
        }

        /// <summary>Begin with a new scene, or report the error of a damaged one.</summary>
        public void Restart(string error)
        {
            foreach (Follower follower in Followers)
            {
                if (Scene.Current == null)
                {
                    follower.Explain(error);
                }
                else
                {
                    follower.Load(Scene.Current);
                }
            }
            sequence = Scene.Current == null ? sequence : 0;
        }

        /// <summary>Give the frame of a message to the followers. Messages of other streams are ignored.</summary>
        public void Take(Message message, FramePool pool)
        {
            if (message.Header.Kind != Kind || !message.Has(topicBytes))
            {
                return;
            }
            Scene scene = Scene.Current;
            if (scene == null || message.Header.Revision != scene.Revision || message.Header.Sequence <= sequence)
            {
                Scene.Discard();
                return;
            }
            sequence = message.Header.Sequence;
            Frame frame = pool.Rent();
            if (!frame.Read(message) || frame.Count != ExpectedCount(scene) || !frame.IsFinite())
            {
                Followers.ForEach(follower => follower.Explain(Scene.Character + ": received a frame of " + Kind + " that does not match the scene"));
                pool.Return(frame);
                return;
            }
            frame.Scene = scene;
            frame.Arrived = connection.Heard;
            frame.Holders = Followers.Count;
            foreach (Follower follower in Followers)
            {
                follower.Enqueue(frame);
            }
        }

        int ExpectedCount(Scene scene)
        {
            switch (Kind)
            {
                case Kind.Controls:
                    return scene.ControlCount;
                case Kind.Morphs:
                    return 1 + scene.Morphs.Count;
                case Kind.Bones:
                    return scene.BoneValueCount;
                default:
                    return 6 * scene.VertexCount;
            }
        }
    }
}
