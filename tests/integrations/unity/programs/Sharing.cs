using System;
using System.Collections.Generic;
using System.Runtime.CompilerServices;
using System.Threading;
using Puppetline.Protocol;

/// <summary>
/// Follows several characters in one program. A line of standard input, "open NAME PORT TOKEN CHARACTER KIND" ("-" for an
/// empty value) or "close NAME", makes or ends a follower; the end of the input ends the program.
/// </summary>
static class Sharing
{
    static readonly Dictionary<string, Follower> Followers = new Dictionary<string, Follower>();
    static readonly Dictionary<string, string> States = new Dictionary<string, string>();
    static readonly Queue<string> Told = new Queue<string>();

    static void Main()
    {
        Said.Open();
        var reading = new Thread(Read) { IsBackground = true };
        reading.Start();
        while (reading.IsAlive || Told.Count > 0)
        {
            lock (Told)
            {
                while (Told.Count > 0)
                {
                    Do(Told.Dequeue().Split(' '));
                }
            }
            foreach (KeyValuePair<string, Follower> each in Followers)
            {
                Say(each.Key, each.Value);
            }
            Thread.Sleep(2);
        }
        Said.End(0);
    }

    static void Read()
    {
        for (string line = Console.In.ReadLine(); line != null; line = Console.In.ReadLine())
        {
            lock (Told)
            {
                Told.Enqueue(line);
            }
        }
    }

    static void Do(string[] words)
    {
        if (words[0] == "close")
        {
            Followers[words[1]].Dispose();
            Followers.Remove(words[1]);
            Said.Line("closed", words[1]);
            return;
        }
        var kind = (Kind)Enum.Parse(typeof(Kind), words[5], true);
        Followers[words[1]] = new Follower("127.0.0.1", int.Parse(words[2]), Text(words[3]), Text(words[4]), kind);
    }

    static string Text(string word) => word == "-" ? "" : word;

    static void Say(string name, Follower follower)
    {
        string state = follower.State + " " + follower.Reason;
        if (!States.TryGetValue(name, out string before) || before != state)
        {
            States[name] = state;
            Said.Line("name", name, "state", follower.State, "reason", follower.Reason);
        }
        if (follower.TryTake(out Frame frame)) // one at a time: where they come faster than they are written, it would never end
        {
            Said.Line(
                "name", name, "frame", frame.Header.Sequence, "character", follower.Character,
                "scene", RuntimeHelpers.GetHashCode(frame.Scene), "values", Said.Bytes(frame.Values, frame.Count));
            follower.Pool.Return(frame);
        }
    }
}
