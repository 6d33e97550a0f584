using System;

namespace Puppetline
{
    /// <summary>Shows frames of one scene in one way.</summary>
    abstract class Display : IDisposable
    {
        /// <summary>Choose the way.</summary>
        public static Display Make(Puppet puppet, Scene scene)
        {
            if (puppet.mode == PuppetMode.Morphs)
            {
                return new BlendShapeDisplay(puppet, scene);
            }
            var look = new Look(puppet.materials, scene);
            return puppet.mode == PuppetMode.Controls && look.BlendsTransforms && GraphicsCardDisplay.Takes(scene)
                ? new GraphicsCardDisplay(puppet, scene, look)
                : (Display)new ProcessorDisplay(puppet, scene, look);
        }

        public abstract void Show(Frame frame);

        public abstract void Dispose();
    }
}
