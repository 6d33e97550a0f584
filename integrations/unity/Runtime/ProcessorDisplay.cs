using Puppetline.Protocol;

namespace Puppetline
{
    /// <summary>Shows vertices that the CPU computes, here or in the service. It supports all materials.</summary>
    sealed class ProcessorDisplay : MeshDisplay
    {
        readonly Puppet puppet;
        readonly SurfaceVertex[] vertices;
        readonly RestPose rest;
        readonly Deformation deformation;

        public ProcessorDisplay(Puppet puppet, Scene scene, Look look)
            : base(puppet, scene, look)
        {
            this.puppet = puppet;
            vertices = new SurfaceVertex[scene.VertexCount];
            rest = new RestPose(scene);
            deformation = puppet.ShownMode == PuppetMode.Controls ? new Deformation(scene, rest.Positions) : null;
        }

        public override void Show(Frame frame)
        {
            if (deformation != null)
            {
                rest.Move(frame.Targets);
            }
            Box box = deformation == null
                ? Surface.Write(frame.Values, frame.Values, 3 * vertices.Length, Axes.Unity, vertices)
                : deformation.Evaluate(frame.Values, puppet.quickNormals ? NormalsBy.Cofactors : NormalsBy.Slopes, Axes.Unity, vertices);
            SetMoving(vertices);
            SetBounds(box);
        }
    }
}
