using Puppetline.Protocol;

namespace Puppetline
{
    /// <summary>How the service sends a character.</summary>
    public enum PuppetMode
    {
        /// <summary>80 transforms per frame, blended on the graphics card or on the CPU.</summary>
        Controls,

        /// <summary>Positions and normals: 24 bytes per vertex and frame.</summary>
        Vertices,

        /// <summary>Quantised positions and normals: 10 bytes per vertex and frame.</summary>
        Vertices16,

        /// <summary>Weights for the blend shapes of an imported .glb from <c>puppetline bake</c>.</summary>
        Morphs,

        /// <summary>Rotations for the bones of another rigged model, which are found by their names.</summary>
        Bones,
    }

    /// <summary>Conversion of modes.</summary>
    static class PuppetModes
    {
        /// <summary>Return the kind of frames that a mode shows.</summary>
        public static Kind ToKind(this PuppetMode mode)
        {
            switch (mode)
            {
                case PuppetMode.Vertices:
                    return Kind.Vertices;
                case PuppetMode.Vertices16:
                    return Kind.Vertices16;
                case PuppetMode.Morphs:
                    return Kind.Morphs;
                case PuppetMode.Bones:
                    return Kind.Bones;
                default:
                    return Kind.Controls;
            }
        }
    }
}
