using UnityEngine;
using UnityEngine.Playables;
using UnityEngine.Timeline;

namespace Puppetline
{
    /// <summary>A clip on a <see cref="PuppetClipTrack"/>.</summary>
    public sealed class PuppetClipPlayableAsset : PlayableAsset, ITimelineClipAsset
    {
        /// <summary>The clip.</summary>
        [Tooltip("The clip.")]
        public PuppetClip clip;

        /// <summary>The features of Timeline that the clip supports.</summary>
        public ClipCaps clipCaps => ClipCaps.Blending | ClipCaps.ClipIn | ClipCaps.Looping | ClipCaps.SpeedMultiplier;

        /// <summary>Duration of the clip, in seconds.</summary>
        public override double duration => clip == null || clip.Clip == null ? base.duration : clip.Clip.Length;

        /// <inheritdoc/>
        public override Playable CreatePlayable(PlayableGraph graph, GameObject owner)
        {
            ScriptPlayable<PuppetClipBehaviour> playable = ScriptPlayable<PuppetClipBehaviour>.Create(graph);
            playable.GetBehaviour().Clip = clip;
            return playable;
        }
    }
}
