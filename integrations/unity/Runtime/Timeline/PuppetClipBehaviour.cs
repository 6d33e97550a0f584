using UnityEngine.Playables;

namespace Puppetline
{
    /// <summary>A clip in a playing Timeline.</summary>
    public sealed class PuppetClipBehaviour : PlayableBehaviour
    {
        /// <summary>The clip.</summary>
        public PuppetClip Clip { get; set; }
    }
}
