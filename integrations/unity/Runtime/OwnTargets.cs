using System;
using System.Collections.Generic;
using Puppetline.Protocol;
using UnityEngine;

namespace Puppetline
{
    /// <summary>The blend shapes that meshes have themselves and the service moves (docs/protocol.md, Targets).</summary>
    sealed class OwnTargets
    {
        readonly List<Shape> shapes = new List<Shape>();

        /// <summary>Find the targets of a scene in meshes, by their names.</summary>
        public OwnTargets(Scene scene, IEnumerable<SkinnedMeshRenderer> renderers)
        {
            foreach (SkinnedMeshRenderer renderer in renderers)
            {
                for (int k = 0; k < scene.Targets.Count && renderer != null && renderer.sharedMesh != null; k++)
                {
                    int index = renderer.sharedMesh.GetBlendShapeIndex(scene.Targets[k]);
                    if (index >= 0)
                    {
                        shapes.Add(new Shape(renderer, index, k));
                    }
                }
            }
        }

        /// <summary>Set the weights of a frame: 0 is the weight at rest, 1 the whole target.</summary>
        public void Show(float[] weights)
        {
            foreach (Shape shape in shapes)
            {
                shape.Show(shape.Target < weights.Length ? weights[shape.Target] : 0);
            }
        }

        /// <summary>Set the weights at rest again.</summary>
        public void Rest()
        {
            Show(Array.Empty<float>());
        }

        sealed class Shape
        {
            public readonly int Target;

            readonly SkinnedMeshRenderer renderer;
            readonly int index;

            /// <summary>Weights at rest and of the whole target, which is 100 or 1, depending on the importer.</summary>
            readonly float atRest, whole;

            public Shape(SkinnedMeshRenderer renderer, int index, int target)
            {
                Target = target;
                this.renderer = renderer;
                this.index = index;
                atRest = renderer.GetBlendShapeWeight(index);
                whole = renderer.sharedMesh.GetBlendShapeFrameWeight(index, 0);
            }

            public void Show(float weight)
            {
                if (renderer != null)
                {
                    renderer.SetBlendShapeWeight(index, atRest + (whole - atRest) * weight);
                }
            }
        }
    }
}
