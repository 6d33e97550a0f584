using System;
using System.Collections.Generic;
using System.Linq;
using System.Reflection;
using Puppetline;
using Puppetline.Protocol;

/// <summary>Prints which of some joints are which bones of skeletons, whose names are told in standard input.</summary>
static class Naming
{
    static int Main()
    {
        Said.Open();
        Json told = Json.Parse(Console.In.ReadToEnd());
        MethodInfo recognise = typeof(BoneName).Assembly.GetType("Puppetline.BoneNames").GetMethod("Recognise");
        for (int i = 0; i < told["skeletons"].Count; i++)
        {
            object[] arguments = { Texts(told["joints"]), Texts(told["skeletons"][i]), new BoneName[0] };
            var found = (Dictionary<string, int>)recognise.Invoke(null, arguments);
            Said.Line("found", found.Select(pair => (object)new object[] { pair.Key, pair.Value }).ToArray());
        }
        Said.End(0);
        return 0;
    }

    static List<string> Texts(Json list) => Enumerable.Range(0, list.Count).Select(i => list[i].Text).ToList();
}
