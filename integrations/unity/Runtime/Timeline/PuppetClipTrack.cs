using UnityEngine;
using UnityEngine.Playables;
using UnityEngine.Timeline;

namespace Puppetline
{
    /// <summary>
    /// A Timeline track of clips for a <see cref="Puppet"/>. Where two clips overlap, they are mixed. In gaps, the last pose
    /// stays.
    /// </summary>
    [TrackColor(0.9f, 0.5f, 0.2f)]
    [TrackBindingType(typeof(Puppet))]
    [TrackClipType(typeof(PuppetClipPlayableAsset))]
    public sealed class PuppetClipTrack : TrackAsset
    {
        /// <inheritdoc/>
        public override Playable CreateTrackMixer(PlayableGraph graph, GameObject go, int inputCount)
        {
            return ScriptPlayable<PuppetClipMixer>.Create(graph, inputCount);
        }
    }
}
