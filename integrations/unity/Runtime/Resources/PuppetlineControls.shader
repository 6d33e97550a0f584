// Shader for Unity's built-in render pipeline, with the lighting of the Standard shader. It blends the transforms of
// controls.
Shader "Puppetline/Controls"
{
    Properties
    {
        _Color ("Colour", Color) = (1, 1, 1, 1)
        _MainTex ("Texture", 2D) = "white" {}
        _Metallic ("Metallic", Range(0, 1)) = 0
        _Glossiness ("Smoothness", Range(0, 1)) = 0.3
        _VertexColors ("Vertex colours", Range(0, 1)) = 0
        [Enum(UnityEngine.Rendering.CullMode)] _Cull ("Cull", Float) = 2
        [HideInInspector] _Puppetline ("Blends transforms", Float) = 1
    }
    SubShader
    {
        Tags { "RenderType" = "Opaque" "DisableBatching" = "True" }
        Cull [_Cull]

        CGPROGRAM
        #pragma surface surf Standard vertex:vert fullforwardshadows addshadow nolightmap nodynlightmap nometa
        #pragma target 3.5
        #include "Puppetline.hlsl"

        struct appdata
        {
            float4 vertex : POSITION;
            float3 normal : NORMAL;
            float4 color : COLOR;
            float4 texcoord : TEXCOORD0;
            float4 coordinates0 : TEXCOORD2;
            float4 coordinates1 : TEXCOORD3;
            float4 slopes0 : TEXCOORD4;
            float4 slopes1 : TEXCOORD5;
            float4 slopes2 : TEXCOORD6;
            float4 slopes3 : TEXCOORD7;
            UNITY_VERTEX_INPUT_INSTANCE_ID
        };

        struct Input
        {
            float2 uv_MainTex;
            float4 color : COLOR;
        };

        sampler2D _MainTex;
        fixed4 _Color;
        half _Metallic, _Glossiness, _VertexColors;

        void vert(inout appdata v)
        {
            PuppetlineRest rest;
            rest.position = v.vertex.xyz;
            rest.normal = v.normal;
            rest.ladder[0] = v.coordinates0;
            rest.ladder[1] = v.coordinates1;
            rest.slopes[0] = v.slopes0;
            rest.slopes[1] = v.slopes1;
            rest.slopes[2] = v.slopes2;
            rest.slopes[3] = v.slopes3;
            PuppetlinePoint blended = PuppetlineBySlopes(rest);
            v.vertex.xyz = blended.position;
            v.normal = blended.normal;
        }

        void surf(Input input, inout SurfaceOutputStandard o)
        {
            float3 own = lerp(float3(1, 1, 1), input.color.rgb, _VertexColors);
            o.Albedo = tex2D(_MainTex, input.uv_MainTex).rgb * _Color.rgb * own;
            o.Metallic = _Metallic;
            o.Smoothness = _Glossiness;
        }
        ENDCG
    }
    FallBack "Diffuse"
}
