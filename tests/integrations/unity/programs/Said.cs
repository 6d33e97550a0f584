using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using System.Runtime.InteropServices;
using System.Text;
using Puppetline.Protocol;

/// <summary>Output of the programs to the tests: one line of JSON per result, arrays in base64.</summary>
static class Said
{
    [DllImport("libc")]
    static extern void _exit(int code);

    static Stream output;

    /// <summary>
    /// Open the output, before the program starts a thread: in Mono, the writer behind Console.WriteLine may be used unfinished while
    /// another thread begins to read the console. The lines are therefore written as bytes, without a writer.
    /// </summary>
    public static void Open()
    {
        output = Console.OpenStandardOutput();
    }

    /// <summary>
    /// End the process at once, no line cut off. Mono's own end sometimes crashes, while it interrupts threads that wait for a socket.
    /// </summary>
    public static void End(int code)
    {
        lock (output)
        {
            _exit(code);
        }
    }

    public static void Line(params object[] namesAndValues)
    {
        var line = new StringBuilder("{");
        for (int i = 0; i < namesAndValues.Length; i += 2)
        {
            line.Append(i == 0 ? "" : ", ").Append(Text((string)namesAndValues[i])).Append(": ").Append(Literal(namesAndValues[i + 1]));
        }
        byte[] bytes = Encoding.UTF8.GetBytes(line.Append("}\n").ToString());
        lock (output)
        {
            output.Write(bytes, 0, bytes.Length);
            output.Flush();
        }
    }

    public static string Bytes<T>(T[] array, int count)
        where T : struct
    {
        var bytes = new byte[count * Marshal.SizeOf(typeof(T))];
        GCHandle pinned = GCHandle.Alloc(array, GCHandleType.Pinned);
        Marshal.Copy(pinned.AddrOfPinnedObject(), bytes, 0, bytes.Length);
        pinned.Free();
        return Convert.ToBase64String(bytes);
    }

    public static string Bytes<T>(T[] array)
        where T : struct
    {
        return array == null ? "" : Bytes(array, array.Length);
    }

    public static object[] Of(Box box)
    {
        return new object[] { box.LowX, box.LowY, box.LowZ, box.HighX, box.HighY, box.HighZ };
    }

    static string Literal(object value)
    {
        if (value is Json json)
        {
            return Written(json);
        }
        if (value is object[] list)
        {
            return "[" + string.Join(", ", Array.ConvertAll(list, Literal)) + "]";
        }
        if (value == null || value is bool)
        {
            return value == null ? "null" : (bool)value ? "true" : "false";
        }
        if (value is string || value is Enum)
        {
            return Text(value.ToString());
        }
        return value is float || value is double
            ? Convert.ToDouble(value).ToString("R", CultureInfo.InvariantCulture)
            : Convert.ToString(value, CultureInfo.InvariantCulture);
    }

    static string Written(Json json)
    {
        switch (json.Kind)
        {
            case JsonKind.Boolean:
                return json.True ? "true" : "false";
            case JsonKind.Number:
                return Literal(json.Number);
            case JsonKind.Text:
                return Text(json.Text);
            case JsonKind.List:
                var values = new List<string>();
                for (int i = 0; i < json.Count; i++)
                {
                    values.Add(Written(json[i]));
                }
                return "[" + string.Join(", ", values) + "]";
            case JsonKind.Map:
                var pairs = new List<string>();
                foreach (string name in json.Names)
                {
                    pairs.Add(Text(name) + ": " + Written(json[name]));
                }
                return "{" + string.Join(", ", pairs) + "}";
            default:
                return "null";
        }
    }

    static string Text(string text)
    {
        var quoted = new StringBuilder("\"");
        foreach (char letter in text)
        {
            quoted.Append(letter < ' ' || letter > '~' || letter == '"' || letter == '\\' ? "\\u" + ((int)letter).ToString("x4") : letter.ToString());
        }
        return quoted.Append('"').ToString();
    }
}
