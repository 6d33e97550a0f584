using UnityEngine;
using UnityEngine.Rendering;

namespace Puppetline
{
    /// <summary>
    /// Shows controls that the vertex shader blends (Puppetline.hlsl): the rest pose goes to the graphics card once, and then
    /// 80 transforms a frame, whatever the mesh.
    /// </summary>
    sealed class GraphicsCardDisplay : MeshDisplay
    {
        /// <summary>Fields that fit into the vertex attributes.</summary>
        const int MostFields = 8;

        /// <summary>Rows that the shader has room for: 80 transforms.</summary>
        const int Rows = 240;

        const int Ladder = 2;

        static readonly int Transforms = Shader.PropertyToID("_PuppetlineTransforms");
        static readonly int Shape = Shader.PropertyToID("_PuppetlineShape");

        readonly ControlBounds bounds;
        readonly MaterialPropertyBlock block = new MaterialPropertyBlock();
        readonly Vector4[] rows = new Vector4[Rows];

        public GraphicsCardDisplay(Puppet puppet, Scene scene, Look look)
            : base(puppet, scene, look, LadderLayout())
        {
            bounds = new ControlBounds(scene);
            var rest = new SurfaceVertex[scene.VertexCount];
            Surface.Write(scene.Positions, scene.Normals, 0, Axes.Unity, rest);
            SetMoving(rest);
            SetLadder();
            block.SetVector(Shape, new Vector4(scene.FieldCount, scene.IsolineCount, 0, 0));
        }

        public static bool Takes(Scene scene)
        {
            return scene.FieldCount <= MostFields && 3 * scene.FieldCount * scene.IsolineCount <= Rows;
        }

        public override void Show(Frame frame)
        {
            int perField = 3 * Scene.IsolineCount;
            for (int row = 0, at = 0; at < frame.Count; row++, at += 4)
            {
                float weight = Scene.Weights[row / perField];
                rows[row] = weight * new Vector4(frame.Values[at], frame.Values[at + 1], frame.Values[at + 2], frame.Values[at + 3]);
            }
            block.SetVectorArray(Transforms, rows);
            Renderer.SetPropertyBlock(block);
            SetBounds(bounds.Of(frame.Values, Axes.Unity));
        }

        public override void Dispose()
        {
            if (Renderer != null)
            {
                Renderer.SetPropertyBlock(null);
            }
            base.Dispose();
        }

        static VertexAttributeDescriptor[] LadderLayout()
        {
            var layout = new VertexAttributeDescriptor[6];
            for (int i = 0; i < layout.Length; i++)
            {
                layout[i] = new VertexAttributeDescriptor(VertexAttribute.TexCoord2 + i, VertexAttributeFormat.Float32, 4, Ladder);
            }
            return layout;
        }

        /// <summary>Give the mesh 8 ladder coordinates a vertex and their 8 pairs of slopes, zero where there are fewer.</summary>
        void SetLadder()
        {
            int fields = Scene.FieldCount;
            var ladder = new LadderVertex[Scene.VertexCount];
            for (int v = 0; v < ladder.Length; v++)
            {
                ladder[v].LadderA = Four(Scene.Ladder, v, fields, 0);
                ladder[v].LadderB = Four(Scene.Ladder, v, fields, 4);
                ladder[v].SlopesA = Four(Scene.Slopes, v, 2 * fields, 0);
                ladder[v].SlopesB = Four(Scene.Slopes, v, 2 * fields, 4);
                ladder[v].SlopesC = Four(Scene.Slopes, v, 2 * fields, 8);
                ladder[v].SlopesD = Four(Scene.Slopes, v, 2 * fields, 12);
            }
            Mesh.SetVertexBufferData(ladder, 0, 0, ladder.Length, Ladder, Unchecked);
        }

        /// <summary>Return up to four numbers of a row, from a column on.</summary>
        static Vector4 Four(float[] numbers, int row, int columns, int column)
        {
            Vector4 four = Vector4.zero;
            for (int i = 0; i < 4 && column + i < columns; i++)
            {
                four[i] = numbers[row * columns + column + i];
            }
            return four;
        }

        struct LadderVertex
        {
            public Vector4 LadderA, LadderB, SlopesA, SlopesB, SlopesC, SlopesD;
        }
    }
}
