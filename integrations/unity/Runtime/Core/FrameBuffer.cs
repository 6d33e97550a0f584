using System.Collections.Generic;

namespace Puppetline.Protocol
{
    /// <summary>Received frames that wait until they are shown.</summary>
    public abstract class FrameBuffer
    {
        readonly FramePool pool;
        readonly Frame mixed = new Frame();

        /// <summary>Make an empty buffer.</summary>
        /// <param name="delay">Delay of the shown frames, in seconds.</param>
        /// <param name="pool">Pool for frames that are not used any more.</param>
        protected FrameBuffer(double delay, FramePool pool)
        {
            Delay = delay;
            this.pool = pool;
        }

        /// <summary>Delay of the shown frames, in seconds; 0 shows the newest frame.</summary>
        public double Delay { get; set; }

        /// <summary>The frame to show, received or interpolated; null before the first frame.</summary>
        public Frame Shown { get; private set; }

        /// <summary>The waiting frames, the oldest first.</summary>
        protected List<Frame> Frames { get; } = new List<Frame>();

        /// <summary>Add a received frame.</summary>
        public abstract void Add(Frame frame);

        /// <summary>Update <see cref="Shown"/>.</summary>
        /// <param name="now">Current time of the buffer's clock, in seconds.</param>
        /// <returns>Whether the frame to show has changed.</returns>
        public abstract bool Update(double now);

        /// <summary>Remove all frames.</summary>
        public virtual void Clear()
        {
            foreach (Frame frame in Frames)
            {
                pool.Return(frame);
            }
            Frames.Clear();
            Shown = null;
        }

        /// <summary>Show the oldest frame, interpolated with the next one.</summary>
        /// <param name="share">Weight of the next one; 0 or less shows the oldest frame itself.</param>
        /// <returns>Whether the frame to show has changed.</returns>
        protected bool ShowOldest(double share)
        {
            if (Frames.Count == 0)
            {
                return false;
            }
            bool between = share > 0;
            bool changed = between || Shown != Frames[0];
            if (between)
            {
                mixed.Mix(Frames[0], Frames[1], (float)share);
            }
            Shown = between ? mixed : Frames[0];
            return changed;
        }

        /// <summary>Remove the oldest frame.</summary>
        protected void Drop()
        {
            if (Shown == Frames[0])
            {
                Shown = null;
            }
            pool.Return(Frames[0]);
            Frames.RemoveAt(0);
        }
    }
}
