using Puppetline.Protocol;
using UnityEngine;
using UnityEngine.Rendering;

namespace Puppetline
{
    /// <summary>
    /// Shows its own mesh. Vertex stream 0 changes in each frame, stream 1 is constant, and stream 2 contains the inputs of
    /// the blending shader.
    /// </summary>
    abstract class MeshDisplay : Display
    {
        /// <summary>Flags that skip checks in each frame that were done when the mesh was made.</summary>
        protected const MeshUpdateFlags Unchecked = MeshUpdateFlags.DontValidateIndices | MeshUpdateFlags.DontRecalculateBounds
            | MeshUpdateFlags.DontResetBoneBounds | MeshUpdateFlags.DontNotifyMeshUsers;

        const int Moving = 0, Still = 1;

        protected readonly Scene Scene;
        protected readonly Mesh Mesh;
        protected readonly MeshRenderer Renderer;
        readonly MeshFilter filter;
        readonly Look look;

        protected MeshDisplay(Puppet puppet, Scene scene, Look look, params VertexAttributeDescriptor[] more)
        {
            Scene = scene;
            this.look = look;
            Mesh = new Mesh { name = "Puppetline " + puppet.Character };
            Mesh.MarkDynamic();
            Mesh.SetVertexBufferParams(scene.VertexCount, Layout(more));
            SetStill();
            SetTriangles();
            filter = Component<MeshFilter>(puppet);
            filter.sharedMesh = Mesh;
            Renderer = Component<MeshRenderer>(puppet);
            Renderer.sharedMaterials = look.Materials;
            Renderer.enabled = false;
        }

        public override void Dispose()
        {
            if (filter != null)
            {
                filter.sharedMesh = null;
            }
            Object.Destroy(Mesh);
            look.Dispose();
        }

        /// <summary>Show the mesh with these bounds. Culling uses them, because it does not know the shader's deformation.</summary>
        protected void SetBounds(Box box)
        {
            Mesh.bounds = BoundsOf(box);
            Renderer.enabled = true;
        }

        protected void SetMoving(SurfaceVertex[] vertices)
        {
            Mesh.SetVertexBufferData(vertices, 0, 0, vertices.Length, Moving, Unchecked);
        }

        static Bounds BoundsOf(Box box)
        {
            var low = new Vector3(box.LowX, box.LowY, box.LowZ);
            var high = new Vector3(box.HighX, box.HighY, box.HighZ);
            return new Bounds(0.5f * (low + high), high - low);
        }

        static T Component<T>(Puppet puppet)
            where T : Component
        {
            return puppet.TryGetComponent(out T there) ? there : puppet.gameObject.AddComponent<T>();
        }

        static VertexAttributeDescriptor[] Layout(VertexAttributeDescriptor[] more)
        {
            var layout = new VertexAttributeDescriptor[4 + more.Length];
            layout[0] = new VertexAttributeDescriptor(VertexAttribute.Position, VertexAttributeFormat.Float32, 3, Moving);
            layout[1] = new VertexAttributeDescriptor(VertexAttribute.Normal, VertexAttributeFormat.Float32, 3, Moving);
            layout[2] = new VertexAttributeDescriptor(VertexAttribute.Color, VertexAttributeFormat.Float32, 4, Still);
            layout[3] = new VertexAttributeDescriptor(VertexAttribute.TexCoord0, VertexAttributeFormat.Float32, 2, Still);
            more.CopyTo(layout, 4);
            return layout;
        }

        /// <summary>Set colours (white if there are none) and texture coordinates from the lower left.</summary>
        void SetStill()
        {
            bool gamma = QualitySettings.activeColorSpace == ColorSpace.Gamma;
            var still = new StillVertex[Scene.VertexCount];
            for (int v = 0; v < still.Length; v++)
            {
                float[] rgb = Scene.Colors, uv = Scene.Uv;
                Color linear = rgb == null ? Color.white : new Color(rgb[3 * v], rgb[3 * v + 1], rgb[3 * v + 2]);
                still[v].Color = gamma ? linear.gamma : linear;
                still[v].Uv = uv == null ? Vector2.zero : new Vector2(uv[2 * v], 1 - uv[2 * v + 1]);
            }
            Mesh.SetVertexBufferData(still, 0, 0, still.Length, Still, Unchecked);
        }

        void SetTriangles()
        {
            int[] indices = Surface.TurnedOver(Scene.Triangles);
            Mesh.SetIndexBufferParams(indices.Length, IndexFormat.UInt32);
            Mesh.SetIndexBufferData(indices, 0, 0, indices.Length, Unchecked);
            Bounds atRest = BoundsOf(BoxAtRest());
            Mesh.subMeshCount = look.Materials.Length;
            for (int i = 0; i < look.Materials.Length; i++)
            {
                SubMeshDescriptor part = Scene.Parts.Count == 0
                    ? new SubMeshDescriptor(0, indices.Length) { vertexCount = Scene.VertexCount }
                    : Descriptor(Scene.Parts[i]);
                part.bounds = atRest;
                Mesh.SetSubMesh(i, part, Unchecked);
            }
        }

        /// <summary>Return the descriptor of a part with its vertex range, which Unity otherwise computes from the indices.</summary>
        static SubMeshDescriptor Descriptor(Part part)
        {
            return new SubMeshDescriptor(3 * part.FirstTriangle, 3 * part.TriangleCount)
            {
                firstVertex = part.FirstVertex,
                vertexCount = part.VertexCount,
            };
        }

        Box BoxAtRest()
        {
            Box box = Box.Nothing;
            for (int at = 0; at < Scene.Positions.Length; at += 3)
            {
                box.Add(-Scene.Positions[at], Scene.Positions[at + 1], Scene.Positions[at + 2]);
            }
            return box;
        }

        struct StillVertex
        {
            public Color Color;
            public Vector2 Uv;
        }
    }
}
