using System;
using System.Collections.Generic;
using System.Linq;
using Puppetline.Protocol;
using UnityEngine;
using Joint = Puppetline.Protocol.Joint;

namespace Puppetline
{
    /// <summary>
    /// Poses the bones of any skeleton by the joints of a character, whatever both rest poses are: rotations of a humanoid count
    /// from the T-pose, which is found for the skeleton by the directions of its arms and legs. Other joints turn as they have
    /// turned since rest (docs/protocol.md, Bones).
    /// </summary>
    /// <remarks>
    /// All arithmetic is in right-handed coordinates, in which x of Unity is negated. Products of quaternions and vectors are the
    /// same in both.
    /// </remarks>
    public sealed class SkeletonPose
    {
        /// <summary>Minimum horizontal length of a foot's unit direction for the foot to have a heading.</summary>
        const float MinHeading = 0.1f;

        /// <summary>Next joint of each limb.</summary>
        static readonly Dictionary<string, string> Next = new Dictionary<string, string>
        {
            ["UpperArm"] = "LowerArm", ["LowerArm"] = "Hand", ["UpperLeg"] = "LowerLeg", ["LowerLeg"] = "Foot", ["Foot"] = "Toes",
        };

        /// <summary>Joint above, whose rotation from the T-pose a joint without a direction has.</summary>
        static readonly Dictionary<string, string> Above = new Dictionary<string, string>
        {
            ["LowerArm"] = "UpperArm", ["Hand"] = "LowerArm", ["LowerLeg"] = "UpperLeg", ["Toes"] = "Foot",
        };

        readonly Transform root;
        readonly IReadOnlyList<Joint> joints;

        /// <summary>Global rotations and positions of the character's joints at rest.</summary>
        readonly Placement[] jointsAtRest;
        readonly Quaternion[] turned;

        /// <summary>The driven bones, parents first.</summary>
        readonly List<DrivenBone> bones = new List<DrivenBone>();
        readonly Quaternion fromCharacter, toSkeleton;
        readonly float ratio = 1;

        /// <summary>Find the bones of a model in its rest pose.</summary>
        /// <param name="scene">The character, with joints.</param>
        /// <param name="root">The object above the bones.</param>
        /// <param name="map">Names of bones for joints that are not recognised.</param>
        public SkeletonPose(Scene scene, Transform root, IReadOnlyList<BoneName> map)
        {
            this.root = root;
            joints = scene.Joints;
            turned = new Quaternion[joints.Count];
            jointsAtRest = AtRest(joints);
            Vector3 up = Axis(scene.Description["up"].Text), ahead = Axis(scene.Description["front"].Text);
            double turn = scene.Description["turn"].Number * Math.PI / 180;
            Vector3 front = (float)Math.Cos(turn) * ahead + (float)Math.Sin(turn) * Vector3.Cross(up, ahead);
            fromCharacter = Quaternion.Inverse(Quaternion.LookRotation(front, up));
            FindBones(map);
            Names = bones.ToDictionary(each => joints[each.Joint].Name, each => each.Bone.name);
            toSkeleton = AxesOfSkeleton();
            foreach (DrivenBone each in bones)
            {
                each.FromTPose = joints[each.Joint].FromTPose == null ? null : (Quaternion?)FromTPose(joints[each.Joint].Name);
            }
            float own = LegLength(PlaceOfJoint), driven = LegLength(PlaceOfBone);
            ratio = own > 0 && driven > 0 ? driven / own : 1;
        }

        /// <summary>Name of the driven bone of each joint.</summary>
        public IReadOnlyDictionary<string, string> Names { get; }

        /// <summary>Pose the bones.</summary>
        /// <param name="values">Numbers of a frame of bones: <see cref="Scene.BoneValueCount"/>.</param>
        /// <param name="movesHips">Whether the hips travel with the character.</param>
        public void Apply(float[] values, bool movesHips = true)
        {
            for (int i = 0; i < turned.Length; i++)
            {
                Quaternion own = QuaternionOf(values, 4 * i);
                turned[i] = joints[i].Parent < 0 ? own : turned[joints[i].Parent] * own;
            }
            foreach (DrivenBone each in bones)
            {
                Quaternion turn = Between(turned[each.Joint] * Quaternion.Inverse(jointsAtRest[each.Joint].Turn), fromCharacter);
                if (each.FromTPose is Quaternion toRest)
                {
                    turn = turn * Between(QuaternionOf(joints[each.Joint].FromTPose, 0), fromCharacter) * Quaternion.Inverse(toRest);
                }
                Quaternion wanted = Between(turn, toSkeleton) * each.AtRest.Turn;
                each.Bone.localRotation = Mirrored(Quaternion.Inverse(GlobalOf(each.Bone.parent).Turn) * wanted);
                if (movesHips && each.Joint == 0 && joints[0].Name == "hips" && joints[0].Travels)
                {
                    Vector3 moved = VectorOf(values, 4 * joints.Count) - jointsAtRest[0].Place;
                    Vector3 place = each.AtRest.Place + ratio * (toSkeleton * (fromCharacter * moved));
                    each.Bone.localPosition = Below(each.Bone.parent, Mirrored(place));
                }
            }
        }

        /// <summary>Put the bones back into the rest pose.</summary>
        public void Rest()
        {
            foreach (DrivenBone each in bones.Where(each => each.Bone != null))
            {
                each.Bone.localRotation = each.LocalRotation;
                each.Bone.localPosition = each.LocalPosition;
            }
        }

        void FindBones(IReadOnlyList<BoneName> map)
        {
            var all = new List<Transform>();
            AddBelow(root, all);
            List<string> names = joints.Select(joint => joint.Name).ToList();
            Dictionary<string, int> found = BoneNames.Recognise(names, all.Select(bone => bone.name).ToList(), map);
            foreach (KeyValuePair<string, int> pair in found.Where(pair => pair.Value >= 0).OrderBy(pair => pair.Value))
            {
                Transform bone = all[pair.Value];
                bones.Add(new DrivenBone(names.IndexOf(pair.Key), bone, GlobalOf(bone)));
            }
        }

        /// <summary>Return the axes of the skeleton nearest to its left, up and front: by its legs or arms, and its head.</summary>
        Quaternion AxesOfSkeleton()
        {
            Vector3? low = PlaceOfBone("hips"), high = PlaceOfBone("head") ?? PlaceOfBone("neck") ?? PlaceOfBone("spine");
            foreach (string part in new[] { "UpperLeg", "UpperArm" })
            {
                if (low != null && high != null && PlaceOfBone("left" + part) is Vector3 left && PlaceOfBone("right" + part) is Vector3 right)
                {
                    Vector3 up = NearestAxis(high.Value - low.Value), across = left - right;
                    Vector3 side = NearestAxis(across - Vector3.Dot(across, up) * up);
                    return Quaternion.LookRotation(Vector3.Cross(side, up), up);
                }
            }
            return Quaternion.identity;
        }

        /// <summary>Return the least rotation from the T-pose to rest, relative to that of the bone above, in the character's axes.</summary>
        Quaternion FromTPose(string joint)
        {
            string side = joint.StartsWith("left") ? "left" : joint.StartsWith("right") ? "right" : null;
            if (side == null)
            {
                return Quaternion.identity;
            }
            string part = joint.Substring(side.Length);
            bool hasAbove = Above.TryGetValue(part, out string above) && PlaceOfBone(side + above) != null;
            Quaternion turn = hasAbove ? FromTPose(side + above) : Quaternion.identity;
            Vector3? end = Next.TryGetValue(part, out string next) ? PlaceOfBone(side + next) : null;
            if (!(PlaceOfBone(joint) is Vector3 start) || end == null)
            {
                return turn;
            }
            Vector3 aim = Quaternion.Inverse(toSkeleton) * (end.Value - start).normalized;
            if (part == "Foot")
            {
                float heading = aim.x * aim.x + aim.z * aim.z > MinHeading * MinHeading ? (float)(Math.Atan2(aim.x, aim.z) * 180 / Math.PI) : 0;
                return Quaternion.AngleAxis(heading, Vector3.up);
            }
            Vector3 straight = part.EndsWith("Leg") ? new Vector3(0, -1, 0) : new Vector3(side == "left" ? 1 : -1, 0, 0);
            return Quaternion.FromToRotation(turn * straight, aim) * turn;
        }

        Vector3? PlaceOfBone(string joint)
        {
            DrivenBone found = bones.Find(each => joints[each.Joint].Name == joint);
            return found == null ? (Vector3?)null : found.AtRest.Place;
        }

        Vector3? PlaceOfJoint(string name)
        {
            for (int i = 0; i < joints.Count; i++)
            {
                if (joints[i].Name == name)
                {
                    return jointsAtRest[i].Place;
                }
            }
            return null;
        }

        /// <summary>Return the length of the left leg; 0 if it is unknown.</summary>
        static float LegLength(Func<string, Vector3?> placeOf)
        {
            return placeOf("leftUpperLeg") is Vector3 hip && placeOf("leftLowerLeg") is Vector3 knee && placeOf("leftFoot") is Vector3 ankle
                ? (knee - hip).magnitude + (ankle - knee).magnitude
                : 0;
        }

        /// <summary>Return the rotation and place of an object relative to the root, right-handed.</summary>
        Placement GlobalOf(Transform bone)
        {
            Quaternion turn = Quaternion.identity;
            Vector3 place = Vector3.zero;
            for (Transform each = bone; each != root; each = each.parent)
            {
                place = each.localPosition + each.localRotation * Vector3.Scale(each.localScale, place);
                turn = each.localRotation * turn;
            }
            return new Placement { Turn = Mirrored(turn), Place = Mirrored(place) };
        }

        /// <summary>Return a point of the root's space in the space of an object below it.</summary>
        Vector3 Below(Transform space, Vector3 point)
        {
            if (space == root)
            {
                return point;
            }
            Vector3 turned = Quaternion.Inverse(space.localRotation) * (Below(space.parent, point) - space.localPosition), scale = space.localScale;
            return new Vector3(turned.x / scale.x, turned.y / scale.y, turned.z / scale.z);
        }

        static void AddBelow(Transform parent, List<Transform> all)
        {
            for (int i = 0; i < parent.childCount; i++)
            {
                all.Add(parent.GetChild(i));
                AddBelow(parent.GetChild(i), all);
            }
        }

        static Placement[] AtRest(IReadOnlyList<Joint> joints)
        {
            var placed = new Placement[joints.Count];
            for (int i = 0; i < placed.Length; i++)
            {
                Quaternion turn = QuaternionOf(joints[i].Rotation, 0);
                Vector3 place = VectorOf(joints[i].Position, 0);
                int parent = joints[i].Parent;
                placed[i] = parent < 0
                    ? new Placement { Turn = turn, Place = place }
                    : new Placement { Turn = placed[parent].Turn * turn, Place = placed[parent].Place + placed[parent].Turn * place };
            }
            return placed;
        }

        /// <summary>Return a rotation in other axes.</summary>
        static Quaternion Between(Quaternion turn, Quaternion axes)
        {
            return axes * turn * Quaternion.Inverse(axes);
        }

        static Quaternion Mirrored(Quaternion turn)
        {
            return new Quaternion(turn.x, -turn.y, -turn.z, turn.w);
        }

        static Vector3 Mirrored(Vector3 point)
        {
            return new Vector3(-point.x, point.y, point.z);
        }

        static Vector3 VectorOf(float[] values, int at)
        {
            return new Vector3(values[at], values[at + 1], values[at + 2]);
        }

        /// <summary>Return a unit quaternion; the mean of two unit quaternions is shorter.</summary>
        static Quaternion QuaternionOf(float[] values, int at)
        {
            return new Quaternion(values[at], values[at + 1], values[at + 2], values[at + 3]).normalized;
        }

        /// <summary>Return the axis of a name, such as "-y".</summary>
        static Vector3 Axis(string name)
        {
            Vector3 axis = name.EndsWith("x") ? Vector3.right : name.EndsWith("y") ? Vector3.up : Vector3.forward;
            return name.StartsWith("-") ? -1 * axis : axis;
        }

        static Vector3 NearestAxis(Vector3 direction)
        {
            float x = Math.Abs(direction.x), y = Math.Abs(direction.y), z = Math.Abs(direction.z);
            return x >= y && x >= z ? new Vector3(Math.Sign(direction.x), 0, 0)
                : y >= z ? new Vector3(0, Math.Sign(direction.y), 0)
                : new Vector3(0, 0, Math.Sign(direction.z));
        }

        struct Placement
        {
            public Quaternion Turn;
            public Vector3 Place;
        }

        /// <summary>A bone, and its pose at rest.</summary>
        sealed class DrivenBone
        {
            public readonly int Joint;
            public readonly Transform Bone;
            public readonly Placement AtRest;
            public readonly Quaternion LocalRotation;
            public readonly Vector3 LocalPosition;

            /// <summary>Rotation from the T-pose to rest, in the character's axes; null for joints without a T-pose.</summary>
            public Quaternion? FromTPose;

            public DrivenBone(int joint, Transform bone, Placement atRest)
            {
                Joint = joint;
                Bone = bone;
                AtRest = atRest;
                LocalRotation = bone.localRotation;
                LocalPosition = bone.localPosition;
            }
        }
    }
}
