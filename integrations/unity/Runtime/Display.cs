using System;
using Puppetline.Protocol;

namespace Puppetline
{
    /// <summary>Base of the classes that show the frames of a scene.</summary>
    abstract class Display : IDisposable
    {
        /// <summary>Make the display for the mode, materials and scene.</summary>
        public static Display Make(Puppet puppet, Scene scene)
        {
            if (puppet.ShownMode == PuppetMode.Morphs)
            {
                return new BlendShapeDisplay(puppet, scene);
            }
            if (puppet.ShownMode == PuppetMode.Bones)
            {
                return new SkeletonDisplay(puppet, scene);
            }
            var look = new Look(puppet.materials, scene);
            return puppet.ShownMode == PuppetMode.Controls && look.BlendsTransforms && GraphicsCardDisplay.Supports(scene)
                ? new GraphicsCardDisplay(puppet, scene, look)
                : (Display)new ProcessorDisplay(puppet, scene, look);
        }

        public abstract void Show(Frame frame);

        /// <summary>Show the same frame in another image.</summary>
        public virtual void Hold()
        {
        }

        /// <summary>Show the frame after the animations of this image.</summary>
        public virtual void ShowOverAnimations()
        {
        }

        public abstract void Dispose();
    }
}
