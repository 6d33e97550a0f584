using System.Collections.Generic;

namespace Puppetline
{
    /// <summary>
    /// Shows frames a little later than they come, and between two of them what is between them: motion is as even as it was
    /// before the source, however unevenly it has travelled. One thread uses it.
    /// </summary>
    public sealed class Playback
    {
        /// <summary>Frames that are kept at most.</summary>
        public const int Capacity = 64;

        /// <summary>
        /// Seconds a second by which the estimate of the shortest journey grows, so that it finds a longer one, and clocks that
        /// do not run alike.
        /// </summary>
        const double Drift = 0.005;

        /// <summary>A frame that comes this many seconds later than others is no late frame: the source has stood still.</summary>
        const double Pause = 0.5;

        readonly FramePool pool;
        readonly List<Frame> frames = new List<Frame>(Capacity);
        readonly Frame mixed = new Frame();

        /// <summary>How far this machine's clock is ahead of the source's, the shortest journey included.</summary>
        double ahead;

        /// <summary>Make one that has nothing to show.</summary>
        /// <param name="delay">Seconds that frames are shown late; 0 shows the newest one as it is.</param>
        /// <param name="pool">Where frames go that are not needed any more.</param>
        public Playback(double delay, FramePool pool)
        {
            Delay = delay;
            this.pool = pool;
        }

        /// <summary>Seconds that frames are shown late; 0 shows the newest one as it is.</summary>
        public double Delay { get; set; }

        /// <summary>What is to be seen at the moment; null if nothing has come. It is one that was taken, or a mixture.</summary>
        public Frame Shown { get; private set; }

        /// <summary>Forget all frames.</summary>
        public void Clear()
        {
            foreach (Frame frame in frames)
            {
                pool.Return(frame);
            }
            frames.Clear();
            Shown = null;
        }

        /// <summary>Take a frame that has come.</summary>
        public void Add(Frame frame)
        {
            Frame newest = frames.Count > 0 ? frames[frames.Count - 1] : null;
            double lead = frame.Arrived - frame.Header.Time;
            if (newest == null || frame.Scene != newest.Scene || frame.Header.Time < newest.Header.Time || lead - ahead > Pause)
            {
                Clear();
                ahead = lead;
            }
            else
            {
                double later = ahead + Drift * (frame.Arrived - newest.Arrived);
                ahead = lead < later ? lead : later;
            }
            if (frames.Count == Capacity)
            {
                Drop();
            }
            frames.Add(frame);
        }

        /// <summary>Find out what is to be seen.</summary>
        /// <param name="now">Of <see cref="Clock"/>.</param>
        /// <returns>Whether that is something else than the last time.</returns>
        public bool Update(double now)
        {
            double time = now - ahead - Delay;
            while (frames.Count > 1 && frames[1].Header.Time <= time)
            {
                Drop();
            }
            if (frames.Count == 0)
            {
                return false;
            }
            Frame earlier = frames[0];
            double share = frames.Count > 1
                ? (time - earlier.Header.Time) / (frames[1].Header.Time - earlier.Header.Time)
                : 0;
            bool between = share > 0;
            bool changed = between || Shown != earlier;
            if (between)
            {
                mixed.Mix(earlier, frames[1], (float)share);
            }
            Shown = between ? mixed : earlier;
            return changed;
        }

        void Drop()
        {
            if (Shown == frames[0])
            {
                Shown = null;
            }
            pool.Return(frames[0]);
            frames.RemoveAt(0);
        }
    }
}
