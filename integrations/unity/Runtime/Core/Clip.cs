using System;
using System.Collections.Generic;

namespace Puppetline.Protocol
{
    /// <summary>A clip file of <c>puppetline clip</c> (docs/clips.md): a character and its motion, without a service.</summary>
    public sealed class Clip
    {
        readonly List<ArraySegment<byte>> frames = new List<ArraySegment<byte>>();

        /// <summary>Times of the frames, in seconds from the first one. Recordings can have pauses.</summary>
        readonly List<double> times = new List<double>();

        double firstTime;

        Clip(byte[] file)
        {
            int number = 0;
            for (int at = 0; at < file.Length; number++)
            {
                if (!Message.TryParse(new ArraySegment<byte>(file, at, file.Length - at), out Message message))
                {
                    throw Damaged(at);
                }
                Take(number, message, at);
                at = message.Targets.Offset + message.Targets.Count;
            }
            if (frames.Count == 0 || frames.Count != Description["frames"].Number)
            {
                throw new FormatException("a clip of " + frames.Count + " frames, and " + Description["frames"].Number + " are described");
            }
        }

        /// <summary>The description of the clip.</summary>
        public Json Description { get; private set; } = Json.Null;

        /// <summary>The character.</summary>
        public Scene Scene { get; private set; }

        /// <summary>Name of the character.</summary>
        public string Character => Description["character"].Text;

        /// <summary>Number of frames, at least 1.</summary>
        public int FrameCount => frames.Count;

        /// <summary>Duration in seconds.</summary>
        public double Length => times[FrameCount - 1];

        /// <summary>Read a clip file. The frames refer to the bytes, and are decoded when they are shown.</summary>
        /// <exception cref="FormatException">It is not a clip file, or is damaged.</exception>
        public static Clip Parse(byte[] file)
        {
            return new Clip(file);
        }

        /// <summary>Return the time of a frame, in seconds from the first one.</summary>
        public double TimeOf(int number)
        {
            return times[number];
        }

        /// <summary>Return the last frame that is not after a time in seconds; the first one for earlier times.</summary>
        public int FrameAt(double seconds)
        {
            int found = times.BinarySearch(seconds);
            return Math.Max(0, found >= 0 ? found : ~found - 1);
        }

        /// <summary>Read a frame.</summary>
        /// <param name="number">Number of the frame, from 0.</param>
        /// <param name="frame">Receives the frame.</param>
        public void Read(int number, Frame frame)
        {
            Message.TryParse(frames[number], out Message message);
            frame.Read(message);
            frame.Scene = Scene;
        }

        void Take(int number, Message message, int at)
        {
            Kind expected = number == 0 ? Kind.Clip : number == 1 ? Kind.Scene : Kind.Controls;
            if (message.Header.Kind != expected)
            {
                throw Damaged(at);
            }
            if (number == 0)
            {
                Description = Json.Parse(message.Payload);
                return;
            }
            if (message.Header.Revision != (number == 1 ? Description["revision"].Number : Scene.Revision))
            {
                throw new FormatException("a message of another scene at byte " + at);
            }
            if (number == 1)
            {
                Scene = Scene.Parse(message);
                return;
            }
            // Only the header is decoded: the decoded numbers of a long clip would take as much memory as the file.
            if (message.Payload.Count != 4 * Scene.ControlCount)
            {
                throw Damaged(at);
            }
            firstTime = frames.Count == 0 ? message.Header.Time : firstTime;
            double time = message.Header.Time - firstTime;
            if (!(frames.Count == 0 ? time == 0 : time > Length))
            {
                throw new FormatException("a frame that is not later than the one before at byte " + at);
            }
            times.Add(time);
            int start = message.TopicBytes.Offset;
            frames.Add(new ArraySegment<byte>(message.Payload.Array, start, message.Targets.Offset + message.Targets.Count - start));
        }

        static FormatException Damaged(int at)
        {
            return new FormatException("a clip that is damaged at byte " + at);
        }
    }
}
