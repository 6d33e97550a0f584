using System.Collections.Generic;
using Puppetline.Protocol;
using UnityEngine;

namespace Puppetline
{
    /// <summary>Shows morphs: sets the weights of the blend shapes of an imported .glb.</summary>
    sealed class BlendShapeDisplay : Display
    {
        readonly List<Skin> skins = new List<Skin>();
        readonly OwnTargets ownTargets;
        readonly Transform rootNode;
        readonly Vector3 rootAtRest;

        public BlendShapeDisplay(Puppet puppet, Scene scene)
        {
            rootNode = puppet.rootNode == null ? Find("puppetline_root", puppet.transform) : puppet.rootNode;
            rootAtRest = rootNode == null ? Vector3.zero : rootNode.localPosition;
            string first = scene.Morphs.Count == 0 ? "" : scene.Morphs[0];
            SkinnedMeshRenderer[] renderers = puppet.skins.Length > 0 ? puppet.skins : puppet.GetComponentsInChildren<SkinnedMeshRenderer>();
            ownTargets = new OwnTargets(scene, renderers);
            foreach (SkinnedMeshRenderer renderer in renderers)
            {
                if (renderer == null || renderer.sharedMesh == null)
                {
                    continue;
                }
                int index = renderer.sharedMesh.GetBlendShapeIndex(first);
                if (index >= 0 && index + scene.Morphs.Count <= renderer.sharedMesh.blendShapeCount)
                {
                    skins.Add(new Skin(renderer, index, scene.Morphs.Count));
                }
            }
            if (skins.Count == 0)
            {
                Debug.LogWarning(
                    "Puppetline: no SkinnedMeshRenderer of this object has the " + scene.Morphs.Count + " blend shapes from '" + first
                        + "' on. Import the .glb from puppetline bake that the service uses, and assign its renderers to 'skins'.",
                    puppet);
            }
        }

        /// <summary>Return an object with a name below another one; null if there is none.</summary>
        static Transform Find(string name, Transform above)
        {
            Transform found = null;
            for (int i = 0; i < above.childCount && found == null; i++)
            {
                Transform child = above.GetChild(i);
                found = child.name == name ? child : Find(name, child);
            }
            return found;
        }

        public override void Show(Frame frame)
        {
            foreach (Skin skin in skins)
            {
                skin.Show(frame.Values);
            }
            ownTargets.Show(frame.Targets);
            if (rootNode != null)
            {
                var root = new Vector3(-frame.Header.RootX, frame.Header.RootY, frame.Header.RootZ);
                rootNode.localPosition = rootAtRest + rootNode.localRotation * Vector3.Scale(rootNode.localScale, root);
            }
        }

        public override void Dispose()
        {
            ownTargets.Rest();
            if (rootNode != null)
            {
                rootNode.localPosition = rootAtRest;
            }
        }

        sealed class Skin
        {
            readonly SkinnedMeshRenderer renderer;
            readonly int first;

            /// <summary>Blend shape weight of a full target, which is 100 or 1, depending on the importer.</summary>
            readonly float[] whole;

            public Skin(SkinnedMeshRenderer renderer, int first, int count)
            {
                this.renderer = renderer;
                this.first = first;
                whole = new float[count];
                for (int k = 0; k < count; k++)
                {
                    whole[k] = renderer.sharedMesh.GetBlendShapeFrameWeight(first + k, 0);
                }
            }

            public void Show(float[] residualAndWeights)
            {
                for (int k = 0; k < whole.Length; k++)
                {
                    renderer.SetBlendShapeWeight(first + k, whole[k] * residualAndWeights[k + 1]);
                }
            }
        }
    }
}
