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
    }
}
