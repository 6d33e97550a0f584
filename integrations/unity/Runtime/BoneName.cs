using System;
using System.Collections.Generic;
using System.Linq;
using System.Text.RegularExpressions;

namespace Puppetline
{
    /// <summary>Name of a bone for the name of a joint.</summary>
    [Serializable]
    public struct BoneName
    {
        /// <summary>Name of a joint of the service's character, such as leftUpperArm or tail_1.</summary>
        public string joint;

        /// <summary>Name of the bone that it drives; empty for none.</summary>
        public string bone;
    }

    /// <summary>
    /// Recognises the bones of a humanoid by their names in other programs: VRM, VRoid, Mixamo, Unreal, Rigify, Godot,
    /// Character Creator, SMPL and others, and common English names, with a side in any spelling.
    /// </summary>
    static class BoneNames
    {
        /// <summary>Names of VRM's bones in the middle of the body, as words without spaces.</summary>
        static readonly Dictionary<string, string> Middle = Meanings(
            "hips: hips pelvis hip",
            "spine: spine spine01 abdomen ab waist",
            "chest: chest spine1 spine02 torso spine001",
            "upperChest: upperchest spine2 spine03 spine002",
            "neck: neck neck01 neck1 necktwist01 spine004",
            "head: head spine006");

        /// <summary>Those of a side.</summary>
        static readonly Dictionary<string, string> Sided = Meanings(
            "Shoulder: shoulder clavicle collar scapula shoulder1",
            "UpperArm: upperarm arm armupper uparm shldr",
            "LowerArm: lowerarm forearm armlower lowarm elbow",
            "Hand: hand wrist",
            "UpperLeg: upperleg upleg thigh legupper hip",
            "LowerLeg: lowerleg leg shin calf leglower lowleg knee",
            "Foot: foot ankle",
            "Toes: toes toebase toe toe0 ball");

        /// <summary>A finger's joint, by its part or by its number from the palm.</summary>
        static readonly Regex Finger = new Regex(
            "^(?:hand|f)?(thumb|index|middle|ring|little|pink[a-z]+)(?:finger)?(?:0*([123])|(metacarpal|proximal|intermediate|distal))$");

        static readonly Dictionary<string, string> Sides = Meanings("left: left l", "right: right r");

        /// <summary>Words that programs put before or after a bone's own name.</summary>
        static readonly HashSet<string> Decoration = new HashSet<string>(
            "def org mixamorig bip01 bip001 j bip c m cc base joint valvebiped".Split(' '));

        static readonly Regex Word = new Regex("[A-Z]?[a-z0-9]+|[A-Z0-9]+");

        /// <summary>Return VRM's name for the name of a bone; null if it is unknown.</summary>
        public static string MeaningOf(string bone)
        {
            string own = bone.Substring(bone.LastIndexOfAny(new[] { ':', '|' }) + 1), side = null, rest = "";
            foreach (Match match in Word.Matches(own))
            {
                string word = match.Value.ToLowerInvariant();
                if (Sides.TryGetValue(word, out string found))
                {
                    side = side ?? found;
                }
                else if (!Decoration.Contains(word))
                {
                    rest += word;
                }
            }
            if ((side == null ? Middle : Sided).TryGetValue(rest, out string meaning))
            {
                return side + meaning;
            }
            Match joint = Finger.Match(rest);
            return side != null && joint.Success ? side + FingerOf(joint) : null;
        }

        /// <summary>Return VRM's name of a finger's joint without its side.</summary>
        static string FingerOf(Match joint)
        {
            string finger = joint.Groups[1].Value.StartsWith("pink") ? "little" : joint.Groups[1].Value;
            string[] parts = finger == "thumb" ? new[] { "metacarpal", "proximal", "distal" } : new[] { "proximal", "intermediate", "distal" };
            string part = joint.Groups[2].Success ? parts[int.Parse(joint.Groups[2].Value) - 1] : joint.Groups[3].Value;
            return char.ToUpperInvariant(finger[0]) + finger.Substring(1) + char.ToUpperInvariant(part[0]) + part.Substring(1);
        }

        /// <summary>
        /// Return the number of the bone for each joint: one of the same name, or of the same meaning. Where programs call an
        /// upper arm "shoulder", a collar bone is before it.
        /// </summary>
        /// <param name="joints">Names of the joints.</param>
        /// <param name="bones">Names of the bones.</param>
        /// <param name="map">Names that replace those that are recognised.</param>
        public static Dictionary<string, int> Recognise(IReadOnlyList<string> joints, List<string> bones, IEnumerable<BoneName> map)
        {
            var found = new Dictionary<string, int>();
            List<string> meanings = bones.ConvertAll(MeaningOf);
            foreach (string joint in joints)
            {
                int same = bones.IndexOf(joint), bone = same >= 0 ? same : meanings.IndexOf(joint);
                bone = bone >= 0 ? bone : meanings.LastIndexOf(joint.Replace("UpperArm", "Shoulder"));
                if (bone >= 0 && !found.ContainsValue(bone))
                {
                    found[joint] = bone;
                }
            }
            foreach (BoneName pair in map.Where(pair => joints.Contains(pair.joint)))
            {
                found[pair.joint] = bones.IndexOf(pair.bone);
            }
            return found;
        }

        static Dictionary<string, string> Meanings(params string[] lines)
        {
            var meanings = new Dictionary<string, string>();
            foreach (string line in lines)
            {
                string[] words = line.Split(' ');
                foreach (string word in words.Skip(1))
                {
                    meanings[word] = words[0].TrimEnd(':');
                }
            }
            return meanings;
        }
    }
}
