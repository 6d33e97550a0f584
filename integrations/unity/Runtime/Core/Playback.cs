namespace Puppetline.Protocol
{
    /// <summary>
    /// Delays and interpolates frames in real time, so that motion is smooth even if frames arrive at irregular times. It is
    /// not thread-safe.
    /// </summary>
    public sealed class Playback : FrameBuffer
    {
        /// <summary>Maximum number of frames in the buffer: a second of the fastest sources.</summary>
        public const int Capacity = 256;

        /// <summary>
        /// Rate at which the estimate of the shortest transmission time grows, in seconds per second, so that it adapts to
        /// longer transmission times and to clock drift.
        /// </summary>
        const double Drift = 0.005;

        /// <summary>Minimum delay of a frame, in seconds, that is treated as a pause of the source and not as a late frame.</summary>
        const double PauseSeconds = 0.5;

        /// <summary>Offset of this machine's clock from the source's, including the shortest transmission time, in seconds.</summary>
        double ahead;

        /// <summary>Make an empty buffer.</summary>
        /// <param name="delay">Delay of the shown frames, in seconds; 0 shows the newest frame.</param>
        /// <param name="pool">Pool for frames that are not used any more.</param>
        public Playback(double delay, FramePool pool)
            : base(delay, pool)
        {
        }

        /// <inheritdoc/>
        public override void Add(Frame frame)
        {
            Frame newest = Frames.Count > 0 ? Frames[Frames.Count - 1] : null;
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
            if (Frames.Count == Capacity)
            {
                Drop();
            }
            Frames.Add(frame);
        }

        /// <inheritdoc/>
        public override bool Update(double now)
        {
            double time = now - ahead - Delay;
            while (Frames.Count > 1 && Frames[1].Header.Time <= time)
            {
                Drop();
            }
            return ShowOldest(Frames.Count > 1 ? (time - Frames[0].Header.Time) / (Frames[1].Header.Time - Frames[0].Header.Time) : 0);
        }
    }
}
