// Blends the transforms of controls on the graphics card, in every pipeline. Unity takes the first SubShader that fits the
// pipeline and the graphics API; the code is in the HLSL files in this folder. Graphics APIs with buffers in vertex shaders use
// those; OpenGL, OpenGL ES 3 and WebGL 2 use a texture.
Shader "Puppetline/Controls"
{
    Properties
    {
        [MainColor] _BaseColor ("Colour", Color) = (1, 1, 1, 1)
        [MainTexture] _BaseMap ("Texture", 2D) = "white" {}
        _Metallic ("Metallic", Range(0, 1)) = 0
        _Smoothness ("Smoothness", Range(0, 1)) = 0.3
        [HDR] _EmissionColor ("Emission", Color) = (0, 0, 0, 1)
        _EmissionMap ("Emission texture", 2D) = "white" {}
        _VertexColors ("Vertex colours", Range(0, 1)) = 0
        [Toggle(_ALPHATEST_ON)] _AlphaClip ("Alpha clipping", Float) = 0
        _Cutoff ("Alpha cutoff", Range(0, 1)) = 0.5
        [Enum(UnityEngine.Rendering.BlendMode)] _SrcBlend ("Source blend", Float) = 1
        [Enum(UnityEngine.Rendering.BlendMode)] _DstBlend ("Destination blend", Float) = 0
        [Enum(Off, 0, On, 1)] _ZWrite ("Write depth", Float) = 1
        [Enum(UnityEngine.Rendering.CullMode)] _Cull ("Cull", Float) = 2
        [HideInInspector] _Puppetline ("Blends transforms", Float) = 1
        [HideInInspector] _BlendMode ("HDRP", Float) = 0
        [HideInInspector] _EnableBlendModePreserveSpecularLighting ("HDRP", Float) = 1
        [HideInInspector] _RayTracing ("HDRP", Float) = 0
        [HideInInspector] _DoubleSidedConstants ("HDRP", Vector) = (1, 1, 1, 0)
    }

    // Universal Render Pipeline.
    SubShader
    {
        PackageRequirements { "com.unity.render-pipelines.universal": "12.0" }
        Tags { "RenderPipeline" = "UniversalPipeline" "RenderType" = "Opaque" "UniversalMaterialType" = "Lit" "DisableBatching" = "True" "AlwaysRenderMotionVectors" = "true" }
        Cull [_Cull]

        Pass
        {
            Name "Forward"
            Tags { "LightMode" = "UniversalForwardOnly" }
            Blend [_SrcBlend] [_DstBlend], One OneMinusSrcAlpha
            ZWrite [_ZWrite]
            HLSLPROGRAM
            #pragma target 4.5
            #pragma exclude_renderers gles gles3 glcore
            #pragma vertex PuppetlineVertex
            #pragma fragment PuppetlineFragment
            #pragma multi_compile_instancing
            #pragma multi_compile_local _ _ALPHATEST_ON
            #pragma multi_compile _ _SURFACE_TYPE_TRANSPARENT
            #pragma multi_compile _ _MAIN_LIGHT_SHADOWS _MAIN_LIGHT_SHADOWS_CASCADE _MAIN_LIGHT_SHADOWS_SCREEN
            #pragma multi_compile _ _ADDITIONAL_LIGHTS_VERTEX _ADDITIONAL_LIGHTS
            #pragma multi_compile _ _FORWARD_PLUS
            #pragma multi_compile _ _CLUSTER_LIGHT_LOOP
            #pragma multi_compile_fragment _ _ADDITIONAL_LIGHT_SHADOWS
            #pragma multi_compile_fragment _ _SHADOWS_SOFT
            #pragma multi_compile_fragment _ _SCREEN_SPACE_OCCLUSION
            #pragma multi_compile_fog
            #define PUPPETLINE_PASS PUPPETLINE_FORWARD
            #include "PuppetlineUniversal.hlsl"
            ENDHLSL
        }

        Pass
        {
            Name "ShadowCaster"
            Tags { "LightMode" = "ShadowCaster" }
            ZWrite On
            ColorMask 0
            HLSLPROGRAM
            #pragma target 4.5
            #pragma exclude_renderers gles gles3 glcore
            #pragma vertex PuppetlineVertex
            #pragma fragment PuppetlineFragment
            #pragma multi_compile_instancing
            #pragma multi_compile_local _ _ALPHATEST_ON
            #pragma multi_compile_vertex _ _CASTING_PUNCTUAL_LIGHT_SHADOW
            #define PUPPETLINE_PASS PUPPETLINE_SHADOW
            #include "PuppetlineUniversal.hlsl"
            ENDHLSL
        }

        Pass
        {
            Name "DepthOnly"
            Tags { "LightMode" = "DepthOnly" }
            ZWrite On
            ColorMask R
            HLSLPROGRAM
            #pragma target 4.5
            #pragma exclude_renderers gles gles3 glcore
            #pragma vertex PuppetlineVertex
            #pragma fragment PuppetlineFragment
            #pragma multi_compile_instancing
            #pragma multi_compile_local _ _ALPHATEST_ON
            #define PUPPETLINE_PASS PUPPETLINE_DEPTH
            #include "PuppetlineUniversal.hlsl"
            ENDHLSL
        }

        Pass
        {
            Name "DepthNormals"
            Tags { "LightMode" = "DepthNormalsOnly" }
            ZWrite On
            HLSLPROGRAM
            #pragma target 4.5
            #pragma exclude_renderers gles gles3 glcore
            #pragma vertex PuppetlineVertex
            #pragma fragment PuppetlineFragment
            #pragma multi_compile_instancing
            #pragma multi_compile_local _ _ALPHATEST_ON
            #define PUPPETLINE_PASS PUPPETLINE_DEPTH_NORMALS
            #include "PuppetlineUniversal.hlsl"
            ENDHLSL
        }

        Pass
        {
            Name "MotionVectors"
            Tags { "LightMode" = "MotionVectors" }
            ColorMask RG
            HLSLPROGRAM
            #pragma target 4.5
            #pragma exclude_renderers gles gles3 glcore
            #pragma vertex PuppetlineVertex
            #pragma fragment PuppetlineFragment
            #pragma multi_compile_instancing
            #pragma multi_compile_local _ _ALPHATEST_ON
            #define PUPPETLINE_PASS PUPPETLINE_MOTION
            #include "PuppetlineUniversal.hlsl"
            ENDHLSL
        }
    }

    // Universal Render Pipeline, with a texture.
    SubShader
    {
        PackageRequirements { "com.unity.render-pipelines.universal": "12.0" }
        Tags { "RenderPipeline" = "UniversalPipeline" "RenderType" = "Opaque" "UniversalMaterialType" = "Lit" "DisableBatching" = "True" "AlwaysRenderMotionVectors" = "true" }
        Cull [_Cull]

        Pass
        {
            Name "Forward"
            Tags { "LightMode" = "UniversalForwardOnly" }
            Blend [_SrcBlend] [_DstBlend], One OneMinusSrcAlpha
            ZWrite [_ZWrite]
            HLSLPROGRAM
            #pragma target 3.5
            #pragma only_renderers gles3 glcore
            #pragma vertex PuppetlineVertex
            #pragma fragment PuppetlineFragment
            #pragma multi_compile_instancing
            #pragma multi_compile_local _ _ALPHATEST_ON
            #pragma multi_compile _ _SURFACE_TYPE_TRANSPARENT
            #pragma multi_compile _ _MAIN_LIGHT_SHADOWS _MAIN_LIGHT_SHADOWS_CASCADE _MAIN_LIGHT_SHADOWS_SCREEN
            #pragma multi_compile _ _ADDITIONAL_LIGHTS_VERTEX _ADDITIONAL_LIGHTS
            #pragma multi_compile _ _FORWARD_PLUS
            #pragma multi_compile _ _CLUSTER_LIGHT_LOOP
            #pragma multi_compile_fragment _ _ADDITIONAL_LIGHT_SHADOWS
            #pragma multi_compile_fragment _ _SHADOWS_SOFT
            #pragma multi_compile_fragment _ _SCREEN_SPACE_OCCLUSION
            #pragma multi_compile_fog
            #define PUPPETLINE_PASS PUPPETLINE_FORWARD
            #include "PuppetlineUniversal.hlsl"
            ENDHLSL
        }

        Pass
        {
            Name "ShadowCaster"
            Tags { "LightMode" = "ShadowCaster" }
            ZWrite On
            ColorMask 0
            HLSLPROGRAM
            #pragma target 3.5
            #pragma only_renderers gles3 glcore
            #pragma vertex PuppetlineVertex
            #pragma fragment PuppetlineFragment
            #pragma multi_compile_instancing
            #pragma multi_compile_local _ _ALPHATEST_ON
            #pragma multi_compile_vertex _ _CASTING_PUNCTUAL_LIGHT_SHADOW
            #define PUPPETLINE_PASS PUPPETLINE_SHADOW
            #include "PuppetlineUniversal.hlsl"
            ENDHLSL
        }

        Pass
        {
            Name "DepthOnly"
            Tags { "LightMode" = "DepthOnly" }
            ZWrite On
            ColorMask R
            HLSLPROGRAM
            #pragma target 3.5
            #pragma only_renderers gles3 glcore
            #pragma vertex PuppetlineVertex
            #pragma fragment PuppetlineFragment
            #pragma multi_compile_instancing
            #pragma multi_compile_local _ _ALPHATEST_ON
            #define PUPPETLINE_PASS PUPPETLINE_DEPTH
            #include "PuppetlineUniversal.hlsl"
            ENDHLSL
        }

        Pass
        {
            Name "DepthNormals"
            Tags { "LightMode" = "DepthNormalsOnly" }
            ZWrite On
            HLSLPROGRAM
            #pragma target 3.5
            #pragma only_renderers gles3 glcore
            #pragma vertex PuppetlineVertex
            #pragma fragment PuppetlineFragment
            #pragma multi_compile_instancing
            #pragma multi_compile_local _ _ALPHATEST_ON
            #define PUPPETLINE_PASS PUPPETLINE_DEPTH_NORMALS
            #include "PuppetlineUniversal.hlsl"
            ENDHLSL
        }
    }

    // High Definition Render Pipeline. The stencil tells HDRP that a pixel has motion of its own.
    SubShader
    {
        PackageRequirements { "com.unity.render-pipelines.high-definition": "12.0" }
        Tags { "RenderPipeline" = "HDRenderPipeline" "RenderType" = "HDLitShader" "DisableBatching" = "True" "AlwaysRenderMotionVectors" = "true" }
        Cull [_Cull]

        Pass
        {
            Name "ShadowCaster"
            Tags { "LightMode" = "ShadowCaster" }
            ZWrite On
            ZClip [_ZClip]
            ColorMask 0
            HLSLPROGRAM
            #pragma target 4.5
            #pragma exclude_renderers gles gles3 glcore
            #pragma vertex PuppetlineVertex
            #pragma fragment Frag
            #pragma multi_compile_instancing
            #pragma multi_compile_local _ _ALPHATEST_ON
            #define SHADERPASS SHADERPASS_SHADOWS
            #include "PuppetlineHighDefinition.hlsl"
            ENDHLSL
        }

        Pass
        {
            Name "DepthForwardOnly"
            Tags { "LightMode" = "DepthForwardOnly" }
            ZWrite On
            HLSLPROGRAM
            #pragma target 4.5
            #pragma exclude_renderers gles gles3 glcore
            #pragma vertex PuppetlineVertex
            #pragma fragment Frag
            #pragma multi_compile_instancing
            #pragma multi_compile_local _ _ALPHATEST_ON
            #pragma multi_compile_fragment _ WRITE_MSAA_DEPTH
            #define SHADERPASS SHADERPASS_DEPTH_ONLY
            #include "PuppetlineHighDefinition.hlsl"
            ENDHLSL
        }

        Pass
        {
            Name "MotionVectors"
            Tags { "LightMode" = "MotionVectors" }
            Stencil { WriteMask 32 Ref 32 Comp Always Pass Replace }
            ZWrite On
            HLSLPROGRAM
            #pragma target 4.5
            #pragma exclude_renderers gles gles3 glcore
            #pragma vertex PuppetlineVertex
            #pragma fragment Frag
            #pragma multi_compile_instancing
            #pragma multi_compile_local _ _ALPHATEST_ON
            #pragma multi_compile_fragment _ WRITE_MSAA_DEPTH
            #define SHADERPASS SHADERPASS_MOTION_VECTORS
            #include "PuppetlineHighDefinition.hlsl"
            ENDHLSL
        }

        Pass
        {
            Name "ForwardOnly"
            Tags { "LightMode" = "ForwardOnly" }
            // HDRP multiplies colours by alpha itself.
            Blend One [_DstBlend], One OneMinusSrcAlpha
            ZWrite [_ZWrite]
            ZTest LEqual
            HLSLPROGRAM
            #pragma target 4.5
            #pragma exclude_renderers gles gles3 glcore
            #pragma vertex PuppetlineVertex
            #pragma fragment Frag
            #pragma multi_compile_instancing
            #pragma multi_compile_local _ _ALPHATEST_ON
            #pragma multi_compile _ _SURFACE_TYPE_TRANSPARENT
            #pragma multi_compile_fragment _ SHADOWS_SHADOWMASK
            #pragma multi_compile_fragment PROBE_VOLUMES_OFF PROBE_VOLUMES_L1 PROBE_VOLUMES_L2
            #pragma multi_compile_fragment SCREEN_SPACE_SHADOWS_OFF SCREEN_SPACE_SHADOWS_ON
            #pragma multi_compile_fragment DECALS_OFF DECALS_3RT DECALS_4RT
            #define SHADERPASS SHADERPASS_FORWARD
            #include "PuppetlineHighDefinition.hlsl"
            ENDHLSL
        }
    }

    // Built-in pipeline.
    SubShader
    {
        Tags { "RenderType" = "Opaque" "DisableBatching" = "True" }
        Cull [_Cull]
        Blend [_SrcBlend] [_DstBlend], One OneMinusSrcAlpha
        ZWrite [_ZWrite]

        CGPROGRAM
        #pragma surface PuppetlineSurface Standard vertex:PuppetlineVertex keepalpha fullforwardshadows addshadow nolightmap nodynlightmap nometa
        #pragma target 4.5
        #pragma exclude_renderers gles gles3 glcore
        #pragma multi_compile_local _ _ALPHATEST_ON
        #include "PuppetlineBuiltIn.hlsl"
        ENDCG
    }

    // Built-in pipeline, with a texture.
    SubShader
    {
        Tags { "RenderType" = "Opaque" "DisableBatching" = "True" }
        Cull [_Cull]
        Blend [_SrcBlend] [_DstBlend], One OneMinusSrcAlpha
        ZWrite [_ZWrite]

        CGPROGRAM
        #pragma surface PuppetlineSurface Standard vertex:PuppetlineVertex keepalpha fullforwardshadows addshadow nolightmap nodynlightmap nometa
        #pragma target 3.5
        #pragma only_renderers gles3 glcore
        #pragma multi_compile_local _ _ALPHATEST_ON
        #include "PuppetlineBuiltIn.hlsl"
        ENDCG
    }
}
