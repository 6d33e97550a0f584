using System;

namespace Puppetline.Protocol
{
    /// <summary>Shows a clip at any time, between its frames too. It is not thread-safe.</summary>
    public sealed class ClipPlayback
    {
        readonly Clip clip;
        readonly Frame mixed = new Frame();
        Frame earlier = new Frame(), later = new Frame();
        int earlierNumber = -1, laterNumber = -1;

        /// <summary>Make a playback of a clip.</summary>
        public ClipPlayback(Clip clip)
        {
            this.clip = clip;
        }

        /// <summary>Return the pose at a time, valid until the next call.</summary>
        /// <param name="seconds">Seconds since the first frame. Before the first frame and after the last one, those are shown.</param>
        public Frame Evaluate(double seconds)
        {
            int number = clip.FrameAt(seconds);
            if (number == laterNumber)
            {
                // Time has passed the later frame, which is now the earlier one.
                Swap();
            }
            Read(earlier, ref earlierNumber, number);
            double start = clip.TimeOf(number);
            if (seconds <= start || number == clip.FrameCount - 1)
            {
                return earlier;
            }
            double share = (seconds - start) / (clip.TimeOf(number + 1) - start);
            Read(later, ref laterNumber, number + 1);
            mixed.Mix(earlier, later, (float)share);
            return mixed;
        }

        /// <summary>Move a position.</summary>
        /// <param name="seconds">The position, in seconds.</param>
        /// <param name="by">Time to move it by, in seconds; negative to go back.</param>
        /// <param name="loops">Whether the clip begins again after its end; if not, it stops there.</param>
        /// <returns>The new position.</returns>
        public double Move(double seconds, double by, bool loops)
        {
            double moved = seconds + by, length = clip.Length;
            return loops && length > 0 ? moved - length * Math.Floor(moved / length) : Math.Max(0, Math.Min(moved, length));
        }

        void Read(Frame frame, ref int held, int number)
        {
            if (held != number)
            {
                clip.Read(number, frame);
                held = number;
            }
        }

        void Swap()
        {
            Frame frame = earlier;
            earlier = later;
            later = frame;
            int number = earlierNumber;
            earlierNumber = laterNumber;
            laterNumber = number;
        }
    }
}
