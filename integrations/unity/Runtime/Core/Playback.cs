using System.Collections.Generic;

namespace Puppetline.Protocol
{
    /// <summary>
    /// Delays and interpolates frames, so that motion is smooth even if frames arrive at irregular times. It is not
    /// thread-safe.
    /// </summary>
    public sealed class Playback
    {
        /// <summary>Maximum number of frames in the buffer.</summary>
        public const int Capacity = 64;

        /// <summary>
        /// Rate at which the estimate of the shortest transmission time grows, in seconds per second, so that it adapts to
        /// longer transmission times and to clock drift.
        /// </summary>
        const double Drift = 0.005;

        /// <summary>Minimum delay of a frame, in seconds, that is treated as a pause of the source and not as a late frame.</summary>
        const double PauseSeconds = 0.5;

        readonly FramePool pool;
        readonly List<Frame> frames = new List<Frame>(Capacity);
        readonly Frame mixed = new Frame();

        /// <summary>Offset of this machine's clock from the source's, including the shortest transmission time, in seconds.</summary>
        double ahead;

        /// <summary>Make an empty buffer.</summary>
        /// <param name="delay">Delay of the shown frames, in seconds; 0 shows the newest frame.</param>
        /// <param name="pool">Pool for frames that are not used any more.</param>
        public Playback(double delay, FramePool pool)
        {
            Delay = delay;
            this.pool = pool;
        }

        /// <summary>Delay of the shown frames, in seconds; 0 shows the newest frame.</summary>
        public double Delay { get; set; }

        /// <summary>The frame to show, received or interpolated; null before the first frame.</summary>
        public Frame Shown { get; private set; }

        /// <summary>Remove all frames.</summary>
        public void Clear()
        {
            foreach (Frame frame in frames)
            {
                pool.Return(frame);
            }
            frames.Clear();
            Shown = null;
        }

        /// <summary>Add a received frame.</summary>
        public void Add(Frame frame)
        {
            Frame newest = frames.Count > 0 ? frames[frames.Count - 1] : null;
            double lead = frame.Arrived - frame.Header.Time;
            if (newest == null || frame.Scene != newest.Scene || frame.Header.Time < newest.Header.Time || lead - ahead > PauseSeconds)
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

        /// <summary>Update <see cref="Shown"/>.</summary>
        /// <param name="now">Current time of <see cref="Clock"/>.</param>
        /// <returns>Whether the frame to show has changed.</returns>
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
