using Puppetline.Protocol;
using UnityEngine;
using UnityEngine.Playables;

namespace Puppetline
{
    /// <summary>Shows the clips of a track at the time of the Timeline, the two with the largest weights mixed.</summary>
    public sealed class PuppetClipMixer : PlayableBehaviour
    {
        /// <inheritdoc/>
        public override void ProcessFrame(Playable playable, FrameData info, object playerData)
        {
            // A component runs in play mode only; the preview of the editor would change its fields in the scene.
            var puppet = Application.isPlaying ? playerData as Puppet : null;
            int heaviest = Heaviest(playable, -1), second = Heaviest(playable, heaviest), first = heaviest;
            if (puppet == null || heaviest < 0)
            {
                return;
            }
            if (second >= 0 && second < heaviest)
            {
                // The order is that of the track, so that the two are not exchanged in the middle of a transition.
                first = second;
                second = heaviest;
            }
            PuppetClip clip = ClipOf(playable, first);
            if (second < 0)
            {
                puppet.ShowClips(clip, Position(playable, first));
                return;
            }
            float weight = playable.GetInputWeight(second);
            puppet.ShowClips(
                clip, Position(playable, first), ClipOf(playable, second), Position(playable, second),
                weight / (weight + playable.GetInputWeight(first)));
        }

        /// <summary>Return the input with the largest weight, except a given one; −1 if no other input has a weight.</summary>
        static int Heaviest(Playable playable, int except)
        {
            int heaviest = -1;
            for (int i = 0; i < playable.GetInputCount(); i++)
            {
                bool counts = i != except && playable.GetInputWeight(i) > 0 && ClipOf(playable, i) != null;
                if (counts && (heaviest < 0 || playable.GetInputWeight(i) > playable.GetInputWeight(heaviest)))
                {
                    heaviest = i;
                }
            }
            return heaviest;
        }

        static PuppetClip ClipOf(Playable playable, int input)
        {
            return ((ScriptPlayable<PuppetClipBehaviour>)playable.GetInput(input)).GetBehaviour().Clip;
        }

        /// <summary>Return the position in the clip, which Timeline itself does not restart when a clip loops.</summary>
        static float Position(Playable playable, int input)
        {
            double time = playable.GetInput(input).GetTime();
            Clip clip = ClipOf(playable, input).Clip;
            return (float)(clip != null && time > clip.Length && clip.Length > 0 ? time % clip.Length : time);
        }
    }
}
