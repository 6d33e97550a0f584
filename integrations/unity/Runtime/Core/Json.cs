using System;
using System.Collections.Generic;
using System.Globalization;
using System.Text;

namespace Puppetline.Protocol
{
    /// <summary>Type of a JSON value.</summary>
    public enum JsonKind
    {
        /// <summary>null, or a missing value.</summary>
        Null,

        /// <summary>true or false.</summary>
        Boolean,

        /// <summary>A number.</summary>
        Number,

        /// <summary>A string.</summary>
        Text,

        /// <summary>A list of values.</summary>
        List,

        /// <summary>An object: values by names.</summary>
        Map,
    }

    /// <summary>
    /// A read-only JSON value. Reading a missing value, or one of another type, returns the empty value of the type:
    /// <see cref="Null"/>, 0, false or an empty string. Untrusted JSON can therefore be read without exceptions.
    /// </summary>
    public sealed class Json
    {
        // These must be initialised before Null, which uses them.
        static readonly List<Json> Empty = new List<Json>();
        static readonly Dictionary<string, Json> Nameless = new Dictionary<string, Json>();

        /// <summary>The value null.</summary>
        public static readonly Json Null = new Json(JsonKind.Null);

        readonly Dictionary<string, Json> map;
        readonly List<Json> list;

        Json(JsonKind kind, double number = 0, string text = "", List<Json> list = null, Dictionary<string, Json> map = null)
        {
            Kind = kind;
            Number = number;
            Text = text;
            this.list = list ?? Empty;
            this.map = map ?? Nameless;
        }

        /// <summary>Type of the value.</summary>
        public JsonKind Kind { get; }

        /// <summary>The number; 0 for other types.</summary>
        public double Number { get; }

        /// <summary>The string; empty for other types.</summary>
        public string Text { get; }

        /// <summary>Whether the value is true.</summary>
        public bool True => Kind == JsonKind.Boolean && Number != 0;

        /// <summary>Number of values in a list; 0 for other types.</summary>
        public int Count => list.Count;

        /// <summary>Names of a map; empty for other types.</summary>
        public IEnumerable<string> Names => map.Keys;

        /// <summary>A value of a list; <see cref="Null"/> if there is none.</summary>
        public Json this[int index] => index >= 0 && index < list.Count ? list[index] : Null;

        /// <summary>A value of a map; <see cref="Null"/> if there is none.</summary>
        public Json this[string name] => map.TryGetValue(name, out Json value) ? value : Null;

        /// <summary>Parse a string.</summary>
        /// <exception cref="FormatException">It is not JSON, or is nested too deep, or has too many values.</exception>
        public static Json Parse(string text)
        {
            return new Reader(text).Whole();
        }

        /// <summary>Parse UTF-8 bytes.</summary>
        /// <exception cref="FormatException">It is not JSON, or is nested too deep, or has too many values.</exception>
        public static Json Parse(ArraySegment<byte> utf8)
        {
            try
            {
                return Parse(Strict.GetString(utf8.Array, utf8.Offset, utf8.Count));
            }
            catch (DecoderFallbackException)
            {
                throw new FormatException("bytes that are not UTF-8");
            }
        }

        static readonly UTF8Encoding Strict = new UTF8Encoding(false, true);

        /// <summary>Recursive-descent parser of one string.</summary>
        sealed class Reader
        {
            const int MaxDepth = 32;

            /// <summary>
            /// Maximum number of values. A value takes about a hundred bytes of memory, but its text only two, so a message
            /// could otherwise exhaust the memory.
            /// </summary>
            const int MaxValues = 200000;

            readonly string text;
            int at;
            int values;

            public Reader(string text)
            {
                this.text = text;
            }

            public Json Whole()
            {
                Json value = Value(0);
                Space();
                return at == text.Length ? value : throw Wrong("the end");
            }

            Json Value(int depth)
            {
                if (depth > MaxDepth)
                {
                    throw new FormatException("JSON nested deeper than " + MaxDepth);
                }
                if (++values > MaxValues)
                {
                    throw new FormatException("JSON of more than " + MaxValues + " values");
                }
                Space();
                switch (at < text.Length ? text[at] : '\0')
                {
                    case '{':
                        return Map(depth);
                    case '[':
                        return List(depth);
                    case '"':
                        return new Json(JsonKind.Text, text: Quoted());
                    case 't':
                        return Word("true", new Json(JsonKind.Boolean, 1));
                    case 'f':
                        return Word("false", new Json(JsonKind.Boolean));
                    case 'n':
                        return Word("null", Null);
                    default:
                        return new Json(JsonKind.Number, Digits());
                }
            }

            Json Map(int depth)
            {
                var map = new Dictionary<string, Json>();
                at++;
                Space();
                for (bool first = true; !Took('}'); first = false)
                {
                    if (!first)
                    {
                        Expect(',');
                        Space();
                    }
                    string name = Quoted();
                    Space();
                    Expect(':');
                    map[name] = Value(depth + 1);
                    Space();
                }
                return new Json(JsonKind.Map, map: map);
            }

            Json List(int depth)
            {
                var list = new List<Json>();
                at++;
                Space();
                for (bool first = true; !Took(']'); first = false)
                {
                    if (!first)
                    {
                        Expect(',');
                    }
                    list.Add(Value(depth + 1));
                    Space();
                }
                return new Json(JsonKind.List, list: list);
            }

            Json Word(string word, Json meaning)
            {
                if (string.CompareOrdinal(text, at, word, 0, word.Length) != 0)
                {
                    throw Wrong(word);
                }
                at += word.Length;
                return meaning;
            }

            double Digits()
            {
                int start = at;
                Took('-');
                if (!Took('0'))
                {
                    SomeDigits();
                }
                if (Took('.'))
                {
                    SomeDigits();
                }
                if (Took('e') || Took('E'))
                {
                    if (!Took('-'))
                    {
                        Took('+');
                    }
                    SomeDigits();
                }
                string digits = text.Substring(start, at - start);
                bool read = double.TryParse(digits, NumberStyles.Float, CultureInfo.InvariantCulture, out double number);
                return read && !double.IsInfinity(number) ? number : throw new FormatException("a number that is too large");
            }

            void SomeDigits()
            {
                int start = at;
                while (at < text.Length && text[at] >= '0' && text[at] <= '9')
                {
                    at++;
                }
                if (at == start)
                {
                    throw Wrong("a value");
                }
            }

            string Quoted()
            {
                Expect('"');
                int plain = at;
                while (at < text.Length && text[at] != '"' && text[at] != '\\' && text[at] >= ' ')
                {
                    at++;
                }
                string start = text.Substring(plain, at - plain);
                return Took('"') ? start : Escaped(new StringBuilder(start));
            }

            string Escaped(StringBuilder written)
            {
                while (!Took('"'))
                {
                    char next = at < text.Length ? text[at] : '\0';
                    if (next < ' ')
                    {
                        throw Wrong("a closing quotation mark");
                    }
                    at++;
                    written.Append(next == '\\' ? Escape() : next);
                }
                return written.ToString();
            }

            char Escape()
            {
                char escaped = at < text.Length ? text[at++] : '\0';
                int known = "\"\\/bfnrt".IndexOf(escaped);
                if (known >= 0)
                {
                    return "\"\\/\b\f\n\r\t"[known];
                }
                string code = escaped == 'u' && at + 4 <= text.Length ? text.Substring(at, 4) : "";
                if (!ushort.TryParse(code, NumberStyles.AllowHexSpecifier, CultureInfo.InvariantCulture, out ushort number))
                {
                    throw Wrong("an escape");
                }
                at += 4;
                return (char)number;
            }

            void Space()
            {
                while (at < text.Length && (text[at] == ' ' || text[at] == '\n' || text[at] == '\r' || text[at] == '\t'))
                {
                    at++;
                }
            }

            bool Took(char wanted)
            {
                bool there = at < text.Length && text[at] == wanted;
                at += there ? 1 : 0;
                return there;
            }

            void Expect(char wanted)
            {
                if (!Took(wanted))
                {
                    throw Wrong(wanted.ToString());
                }
            }

            FormatException Wrong(string expected)
            {
                return new FormatException("not JSON: expected " + expected + " at character " + at);
            }
        }
    }
}
