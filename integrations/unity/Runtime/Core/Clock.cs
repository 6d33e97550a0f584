using System;
using System.Diagnostics;

namespace Puppetline.Protocol
{
    /// <summary>A monotonic clock, the same for all threads.</summary>
    public static class Clock
    {
        /// <summary>Seconds since an arbitrary point in time.</summary>
        public static double Now => Source();

        /// <summary>What tells the time. Tests give another one.</summary>
        internal static Func<double> Source { get; set; } = () => Stopwatch.GetTimestamp() / (double)Stopwatch.Frequency;
    }
}
