using System.Diagnostics;

namespace Puppetline.Protocol
{
    /// <summary>A monotonic clock, the same for all threads.</summary>
    public static class Clock
    {
        /// <summary>Seconds since an arbitrary point in time.</summary>
        public static double Now => Stopwatch.GetTimestamp() / (double)Stopwatch.Frequency;
    }
}
