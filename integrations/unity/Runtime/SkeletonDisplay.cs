using System.Linq;
using Puppetline.Protocol;
using UnityEngine;

namespace Puppetline
{
    /// <summary>Shows bones: poses another rigged model by the names of its bones.</summary>
    sealed class SkeletonDisplay : Display
    {
        readonly SkeletonPose pose;
        readonly Puppet puppet;
        readonly OwnTargets ownTargets;
        float[] values, weights;

        public SkeletonDisplay(Puppet puppet, Scene scene)
        {
            this.puppet = puppet;
            Transform root = puppet.skeleton == null ? puppet.transform : puppet.skeleton;
            pose = new SkeletonPose(scene, root, puppet.boneMap);
            ownTargets = new OwnTargets(scene, puppet.skins.Length > 0 ? puppet.skins : puppet.GetComponentsInChildren<SkinnedMeshRenderer>());
            if (pose.Names.Count == 0)
            {
                string joints = string.Join(", ", scene.Joints.Select(joint => joint.Name));
                Debug.LogWarning(
                    "Puppetline: no bone below '" + root.name + "' has a known name. Assign the object above the bones to 'skeleton', "
                        + "or name bones in 'boneMap' for the joints " + joints + ".",
                    puppet);
            }
            foreach (BoneName pair in puppet.boneMap.Where(pair => !string.IsNullOrEmpty(pair.bone) && !pose.Names.ContainsKey(pair.joint)))
            {
                Debug.LogWarning("Puppetline: boneMap: there is no joint '" + pair.joint + "' or no bone '" + pair.bone + "'.", puppet);
            }
        }

        public override void Show(Frame frame)
        {
            values = frame.Values;
            weights = frame.Targets;
        }

        public override void ShowOverAnimations()
        {
            if (values != null)
            {
                pose.Apply(values, puppet.movesHips);
                ownTargets.Show(weights);
            }
        }

        public override void Dispose()
        {
            pose.Rest();
            ownTargets.Rest();
        }
    }
}
