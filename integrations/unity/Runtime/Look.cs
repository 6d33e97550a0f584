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
            Materials = new Material[Math.Max(1, scene.Parts.Count)];
            Shader shader = given.Length > 0 ? null : Blending();
            made = shader != null;
            for (int i = 0; i < Materials.Length; i++)
            {
                Materials[i] = given.Length > 0 ? given[Math.Min(i, given.Length - 1)]
                    : made ? Plain(shader, scene, i)
                    : GraphicsSettings.currentRenderPipeline.defaultMaterial;
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

        /// <summary>Return the package's shader; null in a pipeline that it does not support.</summary>
        static Shader Blending()
        {
            RenderPipelineAsset pipeline = GraphicsSettings.currentRenderPipeline;
            string name = pipeline == null ? "" : pipeline.GetType().Name;
            bool known = pipeline == null || name == "UniversalRenderPipelineAsset" || name == "HDRenderPipelineAsset";
            Shader shader = known ? Resources.Load<Shader>("PuppetlineControls") : null;
            return shader != null && (pipeline == null || shader.isSupported) ? shader : null;
        }

        /// <summary>Make a material from the values of a part. Vertex colours already include its colour and texture.</summary>
        static Material Plain(Shader shader, Scene scene, int part)
        {
            var material = new Material(shader);
            Json values = part < scene.Parts.Count ? scene.Parts[part].Material : Json.Null;
            material.SetFloat("_VertexColors", scene.Colors != null ? 1 : 0);
            if (values.Kind != JsonKind.Map)
            {
                return material;
            }
            Color color = scene.Colors != null ? Color.white : Linear(values["base_color"]).gamma;
            color.a = values["base_color"].Count > 3 ? (float)values["base_color"][3].Number : 1;
            material.SetColor("_BaseColor", color);
            Color emission = Linear(values["emissive"]);
            // Unity converts the colours of materials to linear ones, but not those that can be brighter than white.
            material.SetColor("_EmissionColor", QualitySettings.activeColorSpace == ColorSpace.Gamma ? emission.gamma : emission);
            material.SetFloat("_Metallic", (float)values["metallic"].Number);
            material.SetFloat("_Smoothness", 1 - (float)values["roughness"].Number);
            material.SetFloat("_Cull", (float)(values["double_sided"].True ? CullMode.Off : CullMode.Back));
            SetAlpha(material, values["alpha_mode"].Text);
            return material;
        }

        static void SetAlpha(Material material, string mode)
        {
            if (mode == "MASK")
            {
                material.SetFloat("_AlphaClip", 1);
                material.EnableKeyword("_ALPHATEST_ON");
                material.SetOverrideTag("RenderType", "TransparentCutout");
                material.renderQueue = (int)RenderQueue.AlphaTest;
            }
            else if (mode == "BLEND")
            {
                material.SetFloat("_SrcBlend", (float)BlendMode.SrcAlpha);
                material.SetFloat("_DstBlend", (float)BlendMode.OneMinusSrcAlpha);
                material.SetFloat("_ZWrite", 0);
                material.EnableKeyword("_SURFACE_TYPE_TRANSPARENT");
                material.SetOverrideTag("RenderType", "Transparent");
                material.renderQueue = (int)RenderQueue.Transparent;
            }
        }

        static Color Linear(Json color)
        {
            return new Color((float)color[0].Number, (float)color[1].Number, (float)color[2].Number);
        }
    }
}
