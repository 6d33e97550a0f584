using System.Diagnostics;

namespace Puppetline
{
    /// <summary>A clock that runs evenly and that all threads share.</summary>
    public static class Clock
    {
        /// <summary>Seconds since some moment.</summary>
        public static double Now => Stopwatch.GetTimestamp() / (double)Stopwatch.Frequency;
    }
}
