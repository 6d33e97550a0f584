using System;
using System.Collections.Generic;
using System.Linq;
using System.Text;
using System.Text.RegularExpressions;
using Puppetline.Protocol;

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

    /// <summary>Recognises the bones of a humanoid by their names in other programs, as capture/bone_names.py does.</summary>
    static class BoneNames
    {
        static readonly Json Table = Json.Parse(BoneTable.Text);
        static readonly Dictionary<string, string> Words = ByWord("words"), Fingers = ByWord("fingers");
        static readonly string[] Decoration = List("decoration"), Controls = List("controls"), Middle = List("middle"), Sided = List("sides");
        static readonly string[] Phalanges = { "metacarpal", "proximal", "intermediate", "distal" };

        static readonly Dictionary<string, string> Sides =
            new Dictionary<string, string> { { "l", "left" }, { "left", "left" }, { "r", "right" }, { "right", "right" } };

        static readonly Regex Word = new Regex("[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+|[^ -~]+"), Digits = new Regex("[.0-9]");
        static readonly Regex[] Glued =
            { new Regex("^(?<side>left|right|l|r)(?<own>.+)$"), new Regex("^(?<own>.+?)(?<side>left|right|l|r)$") };

        static readonly Regex Finger = new Regex(
            $"^(?:hand|finger|f)?({string.Join("|", Fingers.Keys)})(?:finger)?(?:[.]?([0-9]*)|({string.Join("|", Phalanges)}))$");

        /// <summary>A side, empty for none, and the other words of a joint's name.</summary>
        struct Name
        {
            public string Side;
            public string[] Words;

            public string Joined => string.Concat(Words);

            /// <summary>Joined words, an asterisk before those of a side.</summary>
            public string Key => (Side.Length > 0 ? "*" : "") + Joined;
        }

        /// <summary>Return the number of the bone for each joint: one of the same meaning, or of the same name.</summary>
        /// <param name="joints">Names of the joints.</param>
        /// <param name="bones">Names of the bones, parents before their children.</param>
        /// <param name="map">Names that replace those that are recognised.</param>
        public static Dictionary<string, int> Recognise(IReadOnlyList<string> joints, List<string> bones, IEnumerable<BoneName> map)
        {
            var found = FindBones(bones).Where(pair => joints.Contains(pair.Key)).ToDictionary(pair => pair.Key, pair => pair.Value);
            foreach (string joint in joints)
            {
                int bone = bones.IndexOf(joint);
                if (bone >= 0 && !found.ContainsKey(joint) && !found.ContainsValue(bone))
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

        /// <summary>Return which joint of a skeleton is which bone of VRM's humanoid: indices of names, by names of bones.</summary>
        static Dictionary<string, int> FindBones(List<string> names)
        {
            List<string[]> split = WithoutSharedWords(names.ConvertAll(WordsOf));
            List<Name> own = split.ConvertAll(words => WithoutSide(words.Where(word => !Decoration.Contains(word)).ToArray()));
            Dictionary<string, string> convention = ConventionOf(own);
            var joints = new Dictionary<string, List<int>>();
            var fingers = new List<Tuple<string, string, int, int>>();
            for (int i = 0; i < own.Count; i++)
            {
                string part = MeaningOf(own[i], convention, out int order);
                if (order >= 0)
                {
                    fingers.Add(Tuple.Create(own[i].Side, part, order, i));
                }
                else if (part != null)
                {
                    Of(joints, own[i].Side + part).Add(i);
                }
            }
            var found = new Dictionary<string, int>();
            foreach (string side in new[] { "", "left", "right" })
            {
                AddLimbs(found, joints, side);
            }
            foreach (var finger in fingers.GroupBy(finger => Tuple.Create(finger.Item1, finger.Item2)))
            {
                string missing = finger.Key.Item2 == "thumb" ? "intermediate" : "metacarpal";
                int[] chain = finger.OrderBy(each => each.Item3).Select(each => each.Item4).ToArray();
                string[] bones = Phalanges.Where(each => each != missing).ToArray();
                for (int k = 0; k < Math.Min(chain.Length, bones.Length); k++)
                {
                    found[finger.Key.Item1 + Capitalised(finger.Key.Item2) + Capitalised(bones[k])] = chain[k];
                }
            }
            return found;
        }

        /// <summary>Add the bones of a side, or of the middle. The upper arm is the last shoulder if no joint is named after it.</summary>
        static void AddLimbs(Dictionary<string, int> found, Dictionary<string, List<int>> joints, string side)
        {
            if (Of(joints, side + "lowerArm").Count > 0 && Of(joints, side + "upperArm").Count == 0 && Of(joints, side + "shoulder").Count > 0)
            {
                List<int> shoulders = Of(joints, side + "shoulder");
                Of(joints, side + "upperArm").Add(shoulders[shoulders.Count - 1]);
                shoulders.RemoveAt(shoulders.Count - 1);
            }
            string[] parts = side.Length > 0 ? Sided : Middle;
            int[] own = parts.Select(part => Next(Of(joints, side + part))).ToArray();
            for (int k = 0; k < parts.Length; k++)
            {
                foreach (string other in Table["substitutes"][parts[k]].Text.Split(' '))
                {
                    own[k] = own[k] < 0 ? Next(Of(joints, side + other)) : own[k];
                }
                if (own[k] >= 0)
                {
                    found[side.Length > 0 ? side + Capitalised(parts[k]) : parts[k]] = own[k];
                }
            }
        }

        /// <summary>Return the words of names without those before and after them that (nearly) all joints share, and no part is.</summary>
        static List<string[]> WithoutSharedWords(List<string[]> split)
        {
            double least = Table["sharedWordShare"].Number * Math.Max(split.Count(words => words.Length > 0), Table["minSharingJoints"].Number);
            foreach (bool last in new[] { false, true })
            {
                Func<string[], string> end = words => last ? words.LastOrDefault() : words.FirstOrDefault();
                string shared = split.Select(end).Where(word => word != null).GroupBy(word => word).FirstOrDefault(each => each.Count() >= least)?.Key;
                if (shared != null && !Words.ContainsKey(shared) && !Sides.ContainsKey(shared))
                {
                    Func<string[], string[]> rest = words => words.Skip(last ? 0 : 1).Take(words.Length - 1).ToArray();
                    return WithoutSharedWords(split.ConvertAll(words => end(words) == shared ? rest(words) : words));
                }
            }
            return split;
        }

        /// <summary>Return the words of a name in lower case, without its namespace; a point is before each number.</summary>
        static string[] WordsOf(string name)
        {
            string own = name.StartsWith("__") ? "" : name.Split(':', '|').Last().Normalize(NormalizationForm.FormKC);
            MatchCollection words = Word.Matches(own.Replace("左", " left ").Replace("右", " right "));
            return words.Cast<Match>().Select(word => (Digits.IsMatch(word.Value) ? "." : "") + word.Value.ToLowerInvariant()).ToArray();
        }

        /// <summary>Return the side in words, and the other words; a side may be at the beginning or end of a word.</summary>
        static Name WithoutSide(string[] words)
        {
            string side = words.FirstOrDefault(Sides.ContainsKey), key = string.Concat(words);
            if (side != null || IsKnown(key))
            {
                return new Name { Side = side == null ? "" : Sides[side], Words = words.Where(word => !Sides.ContainsKey(word)).ToArray() };
            }
            foreach (Match match in Glued.Select(pattern => pattern.Match(key)))
            {
                if (match.Success && IsKnown(match.Groups["own"].Value))
                {
                    return new Name { Side = Sides[match.Groups["side"].Value], Words = new[] { match.Groups["own"].Value } };
                }
            }
            return new Name { Side = "", Words = words };
        }

        /// <summary>Return parts by the names of the convention that explains most joints; none if a skeleton has few names of it.</summary>
        static Dictionary<string, string> ConventionOf(List<Name> names)
        {
            var best = new Dictionary<string, string>();
            int most = 0;
            foreach (Json convention in Enumerable.Range(0, Table["conventions"].Count).Select(i => Table["conventions"][i]))
            {
                var parts = new Dictionary<string, string>();
                for (int k = 0; k < Middle.Length; k++)
                {
                    parts[convention["middle"].Text.Split(' ')[k]] = Middle[k];
                }
                for (int k = 0; k < Sided.Length; k++)
                {
                    parts["*" + convention["sides"].Text.Split(' ')[k]] = Sided[k];
                }
                int explained = names.Where(name => parts.ContainsKey(name.Key)).Select(name => name.Side + name.Key).Distinct().Count();
                if (explained > most && explained >= convention["least"].Number)
                {
                    best = parts;
                    most = explained;
                }
            }
            return best;
        }

        /// <summary>Return the part of a joint, null for an unknown name, and the number of a finger's joint from the palm, or −1.</summary>
        static string MeaningOf(Name name, Dictionary<string, string> convention, out int order)
        {
            order = -1;
            if (convention.TryGetValue(name.Key, out string part) || Words.TryGetValue(Digits.Replace(name.Joined, ""), out part))
            {
                return part;
            }
            Match finger = Finger.Match(name.Joined);
            if (name.Words.Any(Controls.Contains) || name.Side.Length == 0 || !finger.Success)
            {
                return null;
            }
            string word = finger.Groups[1].Value, number = finger.Groups[2].Value, phalanx = finger.Groups[3].Value;
            bool isPalm = phalanx == "metacarpal" && Fingers[word] != "thumb";
            if (isPalm || (phalanx == "" && number == "" && !char.IsDigit(word[word.Length - 1])))
            {
                return null;
            }
            order = phalanx != "" ? Array.IndexOf(Phalanges, phalanx) : number != "" ? int.Parse(number) : 0;
            return Fingers[word];
        }

        static bool IsKnown(string key) => Words.ContainsKey(Digits.Replace(key, "")) || Finger.IsMatch(key);

        static List<int> Of(Dictionary<string, List<int>> joints, string key)
        {
            if (!joints.TryGetValue(key, out List<int> found))
            {
                joints[key] = found = new List<int>();
            }
            return found;
        }

        /// <summary>Remove the first number and return it; −1 for none.</summary>
        static int Next(List<int> numbers)
        {
            int first = numbers.Count > 0 ? numbers[0] : -1;
            numbers.RemoveRange(0, Math.Min(1, numbers.Count));
            return first;
        }

        static string Capitalised(string word) => char.ToUpperInvariant(word[0]) + word.Substring(1);

        static string[] List(string key) => Table[key].Text.Split(' ');

        static Dictionary<string, string> ByWord(string key)
        {
            var pairs = Table[key].Names.SelectMany(part => Table[key][part].Text.Split(' ').Select(word => new { word, part }));
            return pairs.ToDictionary(pair => pair.word, pair => pair.part);
        }
    }
}
