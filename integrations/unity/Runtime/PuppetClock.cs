namespace Puppetline
{
    /// <summary>The clock that moves a character.</summary>
    public enum PuppetClock
    {
        /// <summary>The time of the machine: the character follows its performer as closely as possible.</summary>
        Realtime,

        /// <summary>The time of the engine: <c>Time.timeScale</c> and recording at a fixed rate change it. No frame is skipped.</summary>
        Engine,

        /// <summary>Calls of <see cref="Puppet.Advance"/>. No frame is skipped.</summary>
        Manual,
    }
}
