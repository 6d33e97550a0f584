using Puppetline.Protocol;
using UnityEngine;

namespace Puppetline
{
    /// <summary>Plays the clips of a <see cref="Puppet"/>: one, or two mixed.</summary>
    sealed class ClipMotion
    {
        readonly Puppet puppet;
        readonly Frame mixed = new Frame();
        PuppetClip clip, other;
        ClipPlayback playback, otherPlayback;
        Vector3 shown = new Vector3(float.NaN, 0, 0);

        public ClipMotion(Puppet puppet)
        {
            this.puppet = puppet;
            Follow();
        }

        /// <summary>The character of the clip; null if the clip is damaged.</summary>
        public Scene Scene { get; private set; }

        public string Character => clip.Clip?.Character;

        /// <summary>Description of an error for the user; empty if there is none.</summary>
        public string Problem { get; private set; } = "";

        /// <summary>Take notice of changes of the puppet's fields.</summary>
        public void Follow()
        {
            if (puppet.clip != clip)
            {
                clip = puppet.clip;
                shown.x = float.NaN;
                playback = Open(clip);
                // Clips of one character have equal scenes; the one that is shown stays.
                Scene = playback != null && Scene != null && clip.Clip.Scene.Revision == Scene.Revision ? Scene : clip.Clip?.Scene;
                other = null;
            }
            if (puppet.blendClip != other)
            {
                other = puppet.blendClip;
                shown.x = float.NaN;
                otherPlayback = other == null ? null : Open(other);
                if (otherPlayback != null && Scene != null && other.Clip.Scene.Revision != Scene.Revision)
                {
                    otherPlayback = null;
                    Warn(other.name + " is a clip of another character than " + clip.name + ", and cannot be blended with it.");
                }
            }
        }

        /// <summary>Move the clips on by a time in seconds.</summary>
        public void Move(float seconds)
        {
            float by = puppet.clipSpeed * seconds;
            if (by != 0 && playback != null)
            {
                puppet.clipPosition = (float)playback.Move(puppet.clipPosition, by, puppet.clipLoops);
            }
            if (by != 0 && otherPlayback != null)
            {
                puppet.blendPosition = (float)otherPlayback.Move(puppet.blendPosition, by, puppet.clipLoops);
            }
        }

        /// <summary>Return whether the pose has changed since the last call.</summary>
        public bool IsChanged()
        {
            var now = new Vector3(puppet.clipPosition, puppet.blendPosition, puppet.blendWeight);
            bool changed = now.x != shown.x || now.y != shown.y || now.z != shown.z;
            shown = now;
            return changed;
        }

        /// <summary>Return the pose at the puppet's positions; null if the clip is damaged.</summary>
        public Frame Evaluate()
        {
            Frame one = playback?.Evaluate(puppet.clipPosition);
            if (one == null || otherPlayback == null || puppet.blendWeight <= 0)
            {
                return one;
            }
            mixed.Mix(one, otherPlayback.Evaluate(puppet.blendPosition), Mathf.Clamp01(puppet.blendWeight));
            return mixed;
        }

        ClipPlayback Open(PuppetClip opened)
        {
            if (opened.Clip == null)
            {
                Warn(opened.Problem);
                return null;
            }
            return new ClipPlayback(opened.Clip);
        }

        void Warn(string problem)
        {
            Problem = problem;
            Debug.LogWarning("Puppetline: " + problem, puppet);
        }
    }
}
