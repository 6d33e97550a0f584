using System;
using Puppetline.Protocol;
using UnityEngine;

namespace Puppetline
{
    /// <summary>
    /// A character and its motion, from a .clip file of <c>puppetline clip</c>. A <see cref="Puppet"/> plays it without a
    /// service. The editor imports .clip files as assets of this class.
    /// </summary>
    public sealed class PuppetClip : ScriptableObject
    {
        [SerializeField]
        [HideInInspector]
        byte[] file = new byte[0];

        Clip clip;

        /// <summary>The clip; null if the file is damaged.</summary>
        public Clip Clip
        {
            get
            {
                if (clip == null && Problem == null)
                {
                    Read();
                }
                return clip;
            }
        }

        /// <summary>Description of the damage; null if there is none, or if <see cref="Clip"/> has not been read.</summary>
        public string Problem { get; private set; }

        /// <summary>Make a clip of the contents of a file.</summary>
        public static PuppetClip Create(byte[] file)
        {
            var made = CreateInstance<PuppetClip>();
            made.file = file;
            return made;
        }

        void Read()
        {
            try
            {
                clip = Clip.Parse(file);
            }
            catch (FormatException error)
            {
                Problem = name + ": found " + error.Message + "; expected a file of puppetline clip. Write it again.";
            }
        }
    }
}
