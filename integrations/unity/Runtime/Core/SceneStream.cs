using System;
using System.Text;

namespace Puppetline.Protocol
{
    /// <summary>Requests the scene of a character over a shared connection. Only the connection's thread uses it.</summary>
    sealed class SceneStream
    {
        /// <summary>Minimum time between two requests of a scene, which doubles each time, and its maximum, in seconds.</summary>
        const double MinRequestSeconds = 1, MaxRequestSeconds = 16;

        readonly ZmtpConnection connection;
        readonly string topic;
        readonly byte[] topicBytes;
        double requested, pause;

        public SceneStream(ZmtpConnection connection, string character)
        {
            this.connection = connection;
            Character = character;
            // With a unique topic, the requests of other clients are not answered here.
            topic = character + "/scene/" + Guid.NewGuid().ToString("N").Substring(0, 24);
            topicBytes = Encoding.ASCII.GetBytes(topic);
            Request(MinRequestSeconds);
        }

        public string Character { get; }

        /// <summary>The scene; null while it is requested.</summary>
        public Scene Current { get; private set; }

        /// <summary>Remove the scene, because frames of another one have arrived, which is requested next.</summary>
        public void Discard()
        {
            Current = null;
        }

        /// <summary>Repeat the request if it has not been answered.</summary>
        public void RepeatRequest()
        {
            if (Current == null && Clock.Now > requested + pause)
            {
                // On a slow network, the requested scene may still be arriving, and each request queues a whole scene.
                connection.Unsubscribe(topic);
                Request(Math.Min(2 * pause, MaxRequestSeconds));
            }
        }

        public void RequestSoon()
        {
            pause = MinRequestSeconds;
        }

        public void Unsubscribe()
        {
            connection.Unsubscribe(topic);
        }

        /// <summary>Read the scene of a message.</summary>
        /// <param name="message">A message of any scene.</param>
        /// <param name="error">Receives the error of a damaged scene; empty if there is none.</param>
        /// <returns>False if the message is not the requested scene.</returns>
        public bool Take(Message message, out string error)
        {
            error = "";
            if (Current != null || !message.Has(topicBytes))
            {
                return false;
            }
            try
            {
                Current = Scene.Parse(message);
                pause = MinRequestSeconds;
            }
            catch (FormatException damage)
            {
                error = Character + ": " + damage.Message;
            }
            return true;
        }

        void Request(double pause)
        {
            connection.Subscribe(topic);
            requested = Clock.Now;
            this.pause = pause;
        }
    }
}
