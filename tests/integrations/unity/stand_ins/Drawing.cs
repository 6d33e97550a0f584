// A stand-in: see README.md.
using System;
using System.Collections.Generic;
using System.Runtime.InteropServices;
using UnityEngine.Rendering;

namespace UnityEngine
{
    public sealed class Mesh : Object
    {
        public readonly byte[][] streams = new byte[4][];
        public readonly List<SubMeshDescriptor> subMeshes = new List<SubMeshDescriptor>();
        public VertexAttributeDescriptor[] layout;
        public int vertexCount;
        public int[] indices;
        public string[] blendShapes = new string[0];
        public float wholeBlendShape = 100;
        public bool dynamic;

        /// <summary>Number of vertex uploads, and their size in bytes.</summary>
        public int uploads;
        public long uploadedBytes;

        public Bounds bounds { get; set; }

        public int subMeshCount { get; set; }

        public int blendShapeCount => blendShapes.Length;

        public void MarkDynamic() => dynamic = true;

        public void SetVertexBufferParams(int vertexCount, params VertexAttributeDescriptor[] attributes)
        {
            this.vertexCount = vertexCount;
            layout = attributes;
        }

        public void SetVertexBufferData<T>(T[] data, int dataStart, int meshBufferStart, int count, int stream, MeshUpdateFlags flags)
            where T : struct
        {
            int size = Marshal.SizeOf(typeof(T));
            if (size != Stride(stream) || meshBufferStart + count > vertexCount || dataStart != 0)
            {
                throw new ArgumentException("vertices of " + size + " bytes for a stream of " + Stride(stream));
            }
            streams[stream] = streams[stream] ?? new byte[size * vertexCount];
            GCHandle pinned = GCHandle.Alloc(data, GCHandleType.Pinned);
            Marshal.Copy(pinned.AddrOfPinnedObject(), streams[stream], meshBufferStart * size, count * size);
            pinned.Free();
            uploads++;
            uploadedBytes += count * size;
        }

        public void SetIndexBufferParams(int indexCount, IndexFormat format) => indices = new int[indexCount];

        public void SetIndexBufferData<T>(T[] data, int dataStart, int meshBufferStart, int count, MeshUpdateFlags flags)
            where T : struct
        {
            Array.Copy(data, dataStart, indices, meshBufferStart, count);
        }

        public void SetSubMesh(int index, SubMeshDescriptor desc, MeshUpdateFlags flags)
        {
            if (index >= subMeshCount)
            {
                throw new IndexOutOfRangeException();
            }
            subMeshes.Add(desc);
        }

        public int GetBlendShapeIndex(string blendShapeName) => Array.IndexOf(blendShapes, blendShapeName);

        public float GetBlendShapeFrameWeight(int shapeIndex, int frameIndex) => wholeBlendShape;

        int Stride(int stream)
        {
            int stride = 0;
            foreach (VertexAttributeDescriptor attribute in layout)
            {
                stride += attribute.stream == stream ? 4 * attribute.dimension : 0;
            }
            return stride;
        }
    }

    public sealed class MeshFilter : Component
    {
        public Mesh sharedMesh { get; set; }
    }

    public class Renderer : Component
    {
        public bool enabled { get; set; }

        public Material[] sharedMaterials { get; set; }
    }

    public sealed class MeshRenderer : Renderer
    {
    }

    public sealed class SkinnedMeshRenderer : Renderer
    {
        public readonly Dictionary<int, float> weights = new Dictionary<int, float>();

        public Mesh sharedMesh { get; set; }

        public void SetBlendShapeWeight(int index, float value) => weights[index] = value;

        public float GetBlendShapeWeight(int index) => weights.TryGetValue(index, out float value) ? value : 0;
    }

    public sealed class Shader : Object
    {
        public static readonly Dictionary<int, object> Globals = new Dictionary<int, object>();

        static readonly List<string> Names = new List<string>();

        public bool isSupported => true;

        public static void SetGlobalBuffer(int nameID, GraphicsBuffer value) => Globals[nameID] = value;

        public static void SetGlobalTexture(int nameID, Texture2D value) => Globals[nameID] = value;

        public static int PropertyToID(string name)
        {
            if (!Names.Contains(name))
            {
                Names.Add(name);
            }
            return Names.IndexOf(name);
        }
    }

    public sealed class Material : Object
    {
        public readonly Shader shader;
        public readonly Dictionary<string, object> properties = new Dictionary<string, object>();
        public readonly List<string> keywords = new List<string>();

        public int renderQueue { get; set; }

        public Material(Shader shader)
        {
            this.shader = shader;
        }

        public bool HasProperty(string name) => shader.name == "PuppetlineControls" && name == "_Puppetline";

        public void SetFloat(string name, float value) => properties[name] = value;

        public void SetColor(string name, Color value) => properties[name] = value;

        public void EnableKeyword(string keyword) => keywords.Add(keyword);

        public void SetOverrideTag(string tag, string val) => properties[tag] = val;
    }

    /// <summary>A buffer that keeps what it is given, and counts it.</summary>
    public sealed class GraphicsBuffer
    {
        public readonly Vector4[] contents;

        public GraphicsBuffer(Target target, int count, int stride)
        {
            contents = new Vector4[count];
            Alive++;
        }

        public enum Target
        {
            Structured,
        }

        public static int Alive { get; private set; }

        public static int UploadedRows { get; private set; }

        public void SetData(Vector4[] data, int managedBufferStartIndex, int graphicsBufferStartIndex, int count)
        {
            Array.Copy(data, managedBufferStartIndex, contents, graphicsBufferStartIndex, count);
            UploadedRows += count;
        }

        public void Release() => Alive--;
    }

    public enum TextureFormat
    {
        RGBAFloat,
    }

    public enum FilterMode
    {
        Point,
    }

    public sealed class Texture2D : Object
    {
        public Vector4[] pixels;
        public Vector4[] contents;

        public Texture2D(int width, int height, TextureFormat textureFormat, bool mipChain, bool linear)
        {
            pixels = new Vector4[width * height];
        }

        public FilterMode filterMode { get; set; }

        public void SetPixelData(Vector4[] data, int mipLevel) => data.CopyTo(pixels, 0);

        public void Apply(bool updateMipmaps) => contents = (Vector4[])pixels.Clone();
    }

    public static class SystemInfo
    {
        public static Rendering.GraphicsDeviceType graphicsDeviceType = Rendering.GraphicsDeviceType.Vulkan;
    }
}

namespace UnityEngine.Rendering
{
    public enum VertexAttribute
    {
        Position,
        Normal,
        Tangent,
        Color,
        TexCoord0,
        TexCoord1,
        TexCoord2,
        TexCoord3,
        TexCoord4,
        TexCoord5,
        TexCoord6,
        TexCoord7,
        BlendWeight,
        BlendIndices,
    }

    public enum VertexAttributeFormat
    {
        Float32,
    }

    public enum IndexFormat
    {
        UInt16,
        UInt32,
    }

    public enum GraphicsDeviceType
    {
        OpenGLES3 = 11,
        OpenGLCore = 17,
        Vulkan = 21,
    }

    public enum BlendMode
    {
        SrcAlpha = 5,
        OneMinusSrcAlpha = 10,
    }

    public enum RenderQueue
    {
        AlphaTest = 2450,
        Transparent = 3000,
    }

    public enum CullMode
    {
        Off,
        Front,
        Back,
    }

    [Flags]
    public enum MeshUpdateFlags
    {
        Default = 0,
        DontValidateIndices = 1,
        DontResetBoneBounds = 2,
        DontNotifyMeshUsers = 4,
        DontRecalculateBounds = 8,
    }

    public struct VertexAttributeDescriptor
    {
        public VertexAttribute attribute;
        public VertexAttributeFormat format;
        public int dimension;
        public int stream;

        public VertexAttributeDescriptor(VertexAttribute attribute, VertexAttributeFormat format, int dimension, int stream)
        {
            this.attribute = attribute;
            this.format = format;
            this.dimension = dimension;
            this.stream = stream;
        }
    }

    public struct SubMeshDescriptor
    {
        public int indexStart, indexCount, firstVertex, vertexCount;

        public Bounds bounds { get; set; }

        public SubMeshDescriptor(int indexStart, int indexCount)
        {
            this.indexStart = indexStart;
            this.indexCount = indexCount;
            firstVertex = vertexCount = 0;
            bounds = default;
        }
    }

    public class RenderPipelineAsset : Object
    {
        public Material material;

        public Material defaultMaterial => material;
    }

    public static class GraphicsSettings
    {
        public static RenderPipelineAsset currentRenderPipeline;
    }
}
