using Puppetline.Protocol;
using UnityEngine;
using UnityEngine.Rendering;

namespace Puppetline
{
    /// <summary>
    /// Shows controls that the vertex shader blends (Puppetline.hlsl). The rest pose is uploaded once, and again when
    /// weights of the mesh's own targets change; each frame has 80 transforms, whatever the size of the mesh.
    /// </summary>
    sealed class GraphicsCardDisplay : MeshDisplay
    {
        /// <summary>Maximum number of fields, which fit into the vertex attributes.</summary>
        const int MaxFields = 8;

        const int ShaderStream = 2;

        readonly ControlBounds bounds;
        readonly RestPose rest;
        readonly SurfaceVertex[] vertices;
        readonly int block;
        readonly Vector4[] rows = new Vector4[TransformBlocks.MaxRows];
        bool isShown;

        public GraphicsCardDisplay(Puppet puppet, Scene scene, Look look)
            : base(puppet, scene, look, ShaderLayout())
        {
            bounds = new ControlBounds(scene);
            rest = new RestPose(scene);
            vertices = new SurfaceVertex[scene.VertexCount];
            SetRest();
            block = TransformBlocks.Rent(scene.FieldCount, scene.IsolineCount);
            SetShaderVertices();
        }

        public static bool Supports(Scene scene)
        {
            return scene.FieldCount <= MaxFields && 3 * scene.FieldCount * scene.IsolineCount <= TransformBlocks.MaxRows;
        }

        public override void Show(Frame frame)
        {
            if (rest.Move(frame.Targets))
            {
                SetRest();
            }
            int perField = 3 * Scene.IsolineCount;
            for (int row = 0, at = 0; at < frame.Count; row++, at += 4)
            {
                float weight = Scene.Weights[row / perField];
                rows[row] = weight * new Vector4(frame.Values[at], frame.Values[at + 1], frame.Values[at + 2], frame.Values[at + 3]);
            }
            TransformBlocks.Show(block, rows, frame.Count / 4, !isShown);
            isShown = true;
            SetBounds(bounds.Of(frame.Values, Axes.Unity));
        }

        public override void Hold()
        {
            TransformBlocks.Hold(block);
        }

        public override void Dispose()
        {
            TransformBlocks.Return(block);
            base.Dispose();
        }

        static VertexAttributeDescriptor[] ShaderLayout()
        {
            var layout = new VertexAttributeDescriptor[7];
            layout[0] = new VertexAttributeDescriptor(VertexAttribute.TexCoord1, VertexAttributeFormat.Float32, 2, ShaderStream);
            for (int i = 1; i < layout.Length; i++)
            {
                layout[i] = new VertexAttributeDescriptor(VertexAttribute.TexCoord1 + i, VertexAttributeFormat.Float32, 4, ShaderStream);
            }
            return layout;
        }

        void SetRest()
        {
            Surface.Write(rest.Positions, Scene.Normals, 0, Axes.Unity, vertices);
            SetMoving(vertices);
        }

        /// <summary>Set the block, and 8 isoline coordinates per vertex and their 8 pairs of slopes, zero for missing fields.</summary>
        void SetShaderVertices()
        {
            int fields = Scene.FieldCount;
            var vertices = new ShaderVertex[Scene.VertexCount];
            for (int v = 0; v < vertices.Length; v++)
            {
                vertices[v].Block = new Vector2(block, 0);
                vertices[v].CoordinatesA = Four(Scene.IsolineCoordinates, v, fields, 0);
                vertices[v].CoordinatesB = Four(Scene.IsolineCoordinates, v, fields, 4);
                vertices[v].SlopesA = Four(Scene.Slopes, v, 2 * fields, 0);
                vertices[v].SlopesB = Four(Scene.Slopes, v, 2 * fields, 4);
                vertices[v].SlopesC = Four(Scene.Slopes, v, 2 * fields, 8);
                vertices[v].SlopesD = Four(Scene.Slopes, v, 2 * fields, 12);
            }
            Mesh.SetVertexBufferData(vertices, 0, 0, vertices.Length, ShaderStream, Unchecked);
        }

        /// <summary>Return four numbers of a row, beginning with a column; zero beyond the last column.</summary>
        static Vector4 Four(float[] numbers, int row, int columns, int column)
        {
            Vector4 four = Vector4.zero;
            for (int i = 0; i < 4 && column + i < columns; i++)
            {
                four[i] = numbers[row * columns + column + i];
            }
            return four;
        }

        struct ShaderVertex
        {
            public Vector2 Block;
            public Vector4 CoordinatesA, CoordinatesB, SlopesA, SlopesB, SlopesC, SlopesD;
        }
    }
}
