using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using Puppetline;
using Puppetline.Protocol;
using UnityEngine;

/// <summary>Poses a skeleton of stand-ins by frames of bones: a scene's payload as argument, the rest from standard input.</summary>
static class Posing
{
    static int Main(string[] arguments)
    {
        Said.Open();
        var message = new Message { Payload = new ArraySegment<byte>(File.ReadAllBytes(arguments[0])) };
        Json told = Json.Parse(Console.In.ReadToEnd());
        var root = new Transform();
        List<Transform> bones = Skeletons.Make(root, told["bones"]);
        BoneName[] map = told["map"].Names.Select(joint => new BoneName { joint = joint, bone = told["map"][joint].Text }).ToArray();
        var pose = new SkeletonPose(Scene.Parse(message), root, map);
        object[] names = pose.Names.Select(pair => (object)new object[] { pair.Key, pair.Value }).ToArray();
        float[] values = Enumerable.Range(0, told["frame"].Count).Select(i => (float)told["frame"][i].Number).ToArray();
        pose.Apply(values, told["movesHips"].True);
        object[] posed = Skeletons.PosesOf(root, bones);
        pose.Rest();
        Said.Line("names", names, "posed", posed, "rest", Skeletons.PosesOf(root, bones));
        Said.End(0);
        return 0;
    }
}
