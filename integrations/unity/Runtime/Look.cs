using System;
using Puppetline.Protocol;
using UnityEngine;
using UnityEngine.Rendering;

namespace Puppetline
{
    /// <summary>The materials of a character, one per part.</summary>
    sealed class Look : IDisposable
    {
        /// <summary>Name of the property that marks shaders that blend the transforms of controls.</summary>
        const string Marker = "_Puppetline";

        readonly bool made;

        public Look(Material[] given, Scene scene)
        {
            RenderPipelineAsset pipeline = GraphicsSettings.currentRenderPipeline;
            Materials = new Material[Math.Max(1, scene.Parts.Count)];
            made = given.Length == 0 && pipeline == null;
            for (int i = 0; i < Materials.Length; i++)
            {
                Materials[i] = given.Length > 0 ? given[Math.Min(i, given.Length - 1)]
                    : pipeline != null ? pipeline.defaultMaterial
                    : Plain(scene, i);
            }
        }

        public Material[] Materials { get; }

        /// <summary>Whether all materials blend the transforms of controls.</summary>
        public bool BlendsTransforms => Array.TrueForAll(Materials, material => material != null && material.HasProperty(Marker));

        public void Dispose()
        {
            for (int i = 0; made && i < Materials.Length; i++)
            {
                UnityEngine.Object.Destroy(Materials[i]);
            }
        }

        /// <summary>Convert glTF's linear colour to the colour space of Unity's materials.</summary>
        static Color Shown(Json color)
        {
            var linear = new Color((float)color[0].Number, (float)color[1].Number, (float)color[2].Number);
            return linear.gamma;
        }

        /// <summary>Make a material from the values of a part. Vertex colours already include its colour and texture.</summary>
        static Material Plain(Scene scene, int part)
        {
            var material = new Material(Resources.Load<Shader>("PuppetlineControls"));
            Json values = part < scene.Parts.Count ? scene.Parts[part].Material : Json.Null;
            if (scene.Colors != null)
            {
                material.SetFloat("_VertexColors", 1);
            }
            else if (values.Kind == JsonKind.Map)
            {
                material.SetColor("_Color", Shown(values["base_color"]));
            }
            if (values.Kind == JsonKind.Map)
            {
                material.SetFloat("_Metallic", (float)values["metallic"].Number);
                material.SetFloat("_Glossiness", 1 - (float)values["roughness"].Number);
                material.SetFloat("_Cull", (float)(values["double_sided"].True ? CullMode.Off : CullMode.Back));
            }
            return material;
        }
    }
}
