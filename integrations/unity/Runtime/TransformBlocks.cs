using System;
using System.Collections.Generic;
using UnityEngine;
using UnityEngine.Rendering;

namespace Puppetline
{
    /// <summary>
    /// The transforms of all characters, in one buffer for the shader (Puppetline.hlsl), with a block for each. The vertices
    /// of a character have the number of its block. Materials therefore need neither copies nor property blocks, which
    /// would disable the SRP Batcher.
    /// </summary>
    static class TransformBlocks
    {
        /// <summary>Maximum number of rows of a pose: 80 transforms of three rows.</summary>
        public const int MaxRows = 240;

        /// <summary>Number of rows of a block: one that describes it, and two poses.</summary>
        const int BlockRows = 512;

        const int MinBlocks = 8;

        static readonly int Buffer = Shader.PropertyToID("_PuppetlineTransforms");
        static readonly int Texture = Shader.PropertyToID("_PuppetlineTexture");

        static readonly SortedSet<int> Free = new SortedSet<int>();

        static Vector4[] rows = new Vector4[0];
        static GraphicsBuffer buffer;
        static Texture2D texture;

        /// <summary>Whether the transforms are in a texture, because the shader cannot read buffers.</summary>
        public static bool InTexture => SystemInfo.graphicsDeviceType == GraphicsDeviceType.OpenGLES3
            || SystemInfo.graphicsDeviceType == GraphicsDeviceType.OpenGLCore;

        /// <summary>Reserve a block, without a pose.</summary>
        public static int Rent(int fields, int isolines)
        {
            if (Free.Count == 0)
            {
                Grow();
            }
            int block = Free.Min;
            Free.Remove(block);
            rows[block * BlockRows] = new Vector4(fields, isolines, 1, 1);
            return block;
        }

        /// <summary>Release a block. The buffer is released with the last one.</summary>
        public static void Return(int block)
        {
            rows[block * BlockRows] = Vector4.zero;
            Free.Add(block);
            if (Free.Count == rows.Length / BlockRows - 1)
            {
                Release();
                rows = new Vector4[0];
                Free.Clear();
            }
        }

        /// <summary>Show a pose. The one that was shown becomes the pose of the previous image.</summary>
        /// <param name="block">The character's block.</param>
        /// <param name="pose">Rows of the transforms.</param>
        /// <param name="count">Number of rows.</param>
        /// <param name="first">Whether this is the first pose of the block.</param>
        public static void Show(int block, Vector4[] pose, int count, bool first)
        {
            int head = block * BlockRows;
            float before = rows[head].z;
            float now = before > 1 || first ? 1 : 1 + MaxRows;
            Array.Copy(pose, 0, rows, head + (int)now, count);
            rows[head].z = now;
            rows[head].w = first ? now : before;
            Upload(head + (int)now, count);
            Upload(head, 1);
            Apply();
        }

        /// <summary>Show the same pose in another image.</summary>
        public static void Hold(int block)
        {
            int head = block * BlockRows;
            if (rows[head].w != rows[head].z)
            {
                rows[head].w = rows[head].z;
                Upload(head, 1);
                Apply();
            }
        }

        static void Grow()
        {
            int before = rows.Length / BlockRows, now = Math.Max(MinBlocks, 2 * before);
            Array.Resize(ref rows, now * BlockRows);
            // Vertices of other meshes refer to block 0, which stays without fields.
            for (int block = Math.Max(1, before); block < now; block++)
            {
                Free.Add(block);
            }
            Release();
            if (InTexture)
            {
                texture = new Texture2D(BlockRows, now, TextureFormat.RGBAFloat, false, true) { filterMode = FilterMode.Point };
                Shader.SetGlobalTexture(Texture, texture);
                Apply();
                return;
            }
            buffer = new GraphicsBuffer(GraphicsBuffer.Target.Structured, rows.Length, 16);
            Shader.SetGlobalBuffer(Buffer, buffer);
            Upload(0, rows.Length);
        }

        static void Release()
        {
            buffer?.Release();
            buffer = null;
            if (texture != null)
            {
                UnityEngine.Object.Destroy(texture);
                texture = null;
            }
        }

        static void Upload(int start, int count)
        {
            buffer?.SetData(rows, start, start, count);
        }

        static void Apply()
        {
            if (texture != null)
            {
                texture.SetPixelData(rows, 0);
                texture.Apply(false);
            }
        }
    }
}
