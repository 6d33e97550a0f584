using System;
using System.Collections.Generic;

namespace Puppetline.Protocol
{
    /// <summary>
    /// Plays frames by a clock of its own, which can be slower than the source: no frame is skipped, and the last one stays
    /// if the clock is faster. It is not thread-safe.
    /// </summary>
    public sealed class FrameQueue : FrameBuffer
    {
        /// <summary>Maximum size of the waiting frames, in bytes. If there are more, the oldest are skipped.</summary>
        const long MaxBytes = 64 << 20;

        /// <summary>Approximate size of a frame besides its numbers, in bytes.</summary>
        const int FrameBytes = 512;

        /// <summary>Relative increase of the speed that reduces a lag.</summary>
        const double MaxRateChange = 0.05;

        /// <summary>Lag beyond the delay that is not reduced, in seconds.</summary>
        const double ToleratedLagSeconds = 0.25;

        readonly List<double> times = new List<double>();
        long bytes;
        double playhead;
        double last = double.NaN;

        /// <summary>Make an empty queue.</summary>
        /// <param name="delay">Delay of the shown frames, in seconds.</param>
        /// <param name="pool">Pool for frames that are not used any more.</param>
        public FrameQueue(double delay, FramePool pool)
            : base(delay, pool)
        {
        }

        /// <summary>Whether a lag behind the source is reduced by faster playback. It grows while the clock is slower than the source.</summary>
        public bool CatchesUp { get; set; }

        /// <inheritdoc/>
        public override void Add(Frame frame)
        {
            double time = playhead + Delay;
            if (Frames.Count > 0)
            {
                Frame newest = Frames[Frames.Count - 1];
                bool continues = frame.Scene == newest.Scene && frame.Header.Time >= newest.Header.Time;
                // A frame that is late is shown immediately, and those after it are shown later.
                time = Math.Max(times[times.Count - 1] + (continues ? frame.Header.Time - newest.Header.Time : 0), playhead);
            }
            Frames.Add(frame);
            times.Add(time);
            bytes += Size(frame);
            while (bytes > MaxBytes && Frames.Count > 1)
            {
                DropOldest();
                playhead = Math.Max(playhead, times[0]);
            }
        }

        /// <inheritdoc/>
        public override bool Update(double now)
        {
            playhead = Frames.Count > 0 ? PlayheadAt(now) : playhead;
            last = now;
            while (Frames.Count > 1 && times[1] <= playhead)
            {
                DropOldest();
            }
            double share = Frames.Count > 1 ? (playhead - times[0]) / (times[1] - times[0]) : 0;
            return ShowOldest(share);
        }

        /// <inheritdoc/>
        public override void Clear()
        {
            base.Clear();
            times.Clear();
            bytes = 0;
        }

        /// <summary>Return whether the frames for a time have arrived.</summary>
        public bool Reaches(double now)
        {
            return Frames.Count > 0 && PlayheadAt(now) <= times[times.Count - 1];
        }

        double PlayheadAt(double now)
        {
            if (double.IsNaN(last))
            {
                return playhead;
            }
            bool lags = CatchesUp && times[times.Count - 1] - playhead > Delay + ToleratedLagSeconds;
            return playhead + (now - last) * (lags ? 1 + MaxRateChange : 1);
        }

        static long Size(Frame frame) => 4L * (frame.Values.Length + frame.Targets.Length) + FrameBytes;

        void DropOldest()
        {
            bytes -= Size(Frames[0]);
            times.RemoveAt(0);
            Drop();
        }
    }
}
