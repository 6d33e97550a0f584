namespace Puppetline
{
    /// <summary>Made by integrations/write_bone_tables.py from capture/bone_names.toml.</summary>
    static class BoneTable
    {
        public const string Text = @"{
  ""conventions"": [
    {
      ""middle"": ""hips spine chest upperchest neck head jaw"",
      ""sides"": ""shoulder upperarm lowerarm hand upperleg lowerleg foot toes"",
      ""least"": 18
    },
    {
      ""middle"": ""hips spine spine.1 spine.2 neck head -"",
      ""sides"": ""shoulder arm forearm hand upleg leg foot toe"",
      ""least"": 17
    },
    {
      ""middle"": ""pelvis spine.01 spine.02 spine.03 neck.01 head -"",
      ""sides"": ""clavicle upperarm lowerarm hand thigh calf foot ball"",
      ""least"": 17
    },
    {
      ""middle"": ""spine spine.001 spine.002 spine.003 spine.004 spine.006 -"",
      ""sides"": ""shoulder upperarm forearm hand thigh shin foot toe"",
      ""least"": 17
    },
    {
      ""middle"": ""pelvis spine.1 spine.2 spine.3 neck head -"",
      ""sides"": ""collar shoulder elbow wrist hip knee ankle foot"",
      ""least"": 17
    },
    {
      ""middle"": ""hip waist spine.01 spine.02 necktwist.01 head -"",
      ""sides"": ""clavicle upperarm forearm hand thigh calf foot toe"",
      ""least"": 17
    },
    {
      ""middle"": ""hips spine chest upperchest neck head -"",
      ""sides"": ""shoulder upperarm lowerarm hand upperleg lowerleg foot toe"",
      ""least"": 17
    },
    {
      ""middle"": ""hip ab chest - neck head -"",
      ""sides"": ""shoulder uarm farm hand thigh shin foot toe"",
      ""least"": 16
    },
    {
      ""middle"": ""root spine.1 spine.2 chest neck head -"",
      ""sides"": ""scapula shoulder elbow wrist hip knee ankle toes"",
      ""least"": 17
    },
    {
      ""middle"": ""hips spine.1 spine.4 spine.7 neck.1 head -"",
      ""sides"": ""shoulder.1 arm forearm hand upleg leg foot toes"",
      ""least"": 17
    },
    {
      ""middle"": ""センター 上半身 - 上半身.2 首 頭 -"",
      ""sides"": ""肩 腕 ひじ 手首 足 ひざ 足首 つま先"",
      ""least"": 16
    },
    {
      ""middle"": ""hips lowerback spine spine.1 neck head -"",
      ""sides"": ""shoulder arm forearm hand upleg leg foot toe"",
      ""least"": 17
    },
    {
      ""middle"": ""root lowerback upperback thorax lowerneck head -"",
      ""sides"": ""clavicle humerus radius wrist femur tibia foot toes"",
      ""least"": 17
    },
    {
      ""middle"": ""pelvis spine spine.1 spine.2 neck head -"",
      ""sides"": ""clavicle upperarm forearm hand thigh calf foot toe.0"",
      ""least"": 17
    },
    {
      ""middle"": ""spine spinemid - - spineshoulder head -"",
      ""sides"": ""- shoulder elbow wrist hip knee ankle foot"",
      ""least"": 14
    },
    {
      ""middle"": ""pelvis spinenaval spinechest - neck head -"",
      ""sides"": ""clavicle shoulder elbow wrist hip knee ankle foot"",
      ""least"": 16
    },
    {
      ""middle"": ""midhip - - - neck - -"",
      ""sides"": ""- shoulder elbow wrist hip knee ankle bigtoe"",
      ""least"": 12
    },
    {
      ""middle"": ""hip spine - - thorax head -"",
      ""sides"": ""- shoulder elbow wrist hip knee foot -"",
      ""least"": 12
    },
    {
      ""middle"": ""hips abdomen torso chest neck head -"",
      ""sides"": ""shoulder upperarm lowerarm hand upperleg lowerleg foot toes"",
      ""least"": 17
    },
    {
      ""middle"": ""hips spine chest - - head -"",
      ""sides"": ""- upperarm lowerarm wrist upperleg lowerleg foot toes"",
      ""least"": 14
    }
  ],
  ""middle"": ""hips spine chest upperChest neck head jaw"",
  ""sides"": ""shoulder upperArm lowerArm hand upperLeg lowerLeg foot toes"",
  ""substitutes"": {
    ""hips"": ""root"",
    ""chest"": ""spine"",
    ""upperChest"": ""chest spine"",
    ""head"": ""neck"",
    ""palm"": ""hand"",
    ""upperLeg"": ""hips leg"",
    ""lowerLeg"": ""leg"",
    ""toes"": ""foot""
  },
  ""words"": {
    ""root"": ""root center センター"",
    ""hips"": ""hip hips pelvis midhip lowerbody hanche bassin huefte becken cadera anca bacino quadril 下半身"",
    ""spine"": ""spine abdomen ab waist torso back lowerback spinelower upperbody colonne wirbelsaeule ruecken columna colonna coluna 上半身"",
    ""chest"": ""chest breast ribcage poitrine brust pecho petto peito"",
    ""upperChest"": ""upperchest upperback spineupper"",
    ""trunk"": ""body"",
    ""neck"": ""neck nec lowerneck upperneck cou hals cuello collo pescoco 首"",
    ""head"": ""head skull tete kopf cabeza testa cabeca 頭"",
    ""jaw"": ""jaw jawroot mandible chin lowermouth mouthlower lowerjaw jawlower machoire kiefer mandibula あご 顎"",
    ""eye"": ""eye eyes oeil auge ojo occhio olho 目"",
    ""face"": ""face nose mouth muzzle snout beak bill brow eyebrow eyelid lid cheek lip lips tongue teeth tusk"",
    ""ear"": ""ear ears oreille ohr oreja orecchio orelha 耳"",
    ""shoulder"": ""shoulder sho clavicle collar collarbone scapula epaule schulter hombro spalla ombro 肩"",
    ""upperArm"": ""arm upperarm armupper uparm uarm shldr humerus bras oberarm brazo braccio braco 腕"",
    ""lowerArm"": ""lowerarm armlower lowarm loarm farm forearm elbow elb radius ulna coude avantbras ellenbogen unterarm codo antebrazo gomito avambraccio cotovelo antebraco ひじ 肘"",
    ""hand"": ""hand wrist poignet handgelenk muneca mano polso pulso mao 手首"",
    ""palm"": ""palm palmt palmi palmm palmr palmp fingers handend"",
    ""upperLeg"": ""upperleg legupper upleg thigh femur cuisse oberschenkel muslo coscia coxa もも"",
    ""lowerLeg"": ""lowerleg leglower lowleg loleg calf shin shank knee kne tibia fibula genou mollet knie unterschenkel rodilla ginocchio joelho ひざ 膝"",
    ""leg"": ""leg midleg jambe bein pierna gamba perna 足"",
    ""foot"": ""foot feet footback ankle talus paw hoof shoe boot pied cheville fuss knoechel tobillo piede caviglia tornozelo 足首"",
    ""toes"": ""toe toes toebase ball football bigtoe orteil orteils zeh zehen つま先"",
    ""tail"": ""tail queue schwanz cola coda cauda 尻尾"",
    ""wing"": ""wing feather fin flipper topflipper midflipper bottomflipper aile fluegel ala asa 翼 羽""
  },
  ""fingers"": {
    ""thumb"": ""thumb finger.0 親指"",
    ""index"": ""index finger.1 人指 人差指"",
    ""middle"": ""middle mid finger.2 中指"",
    ""ring"": ""ring finger.3 薬指"",
    ""little"": ""little pinky pinkie finger.4 小指""
  },
  ""decoration"": ""a b c d e g i j k m n o p q s t v w x y z mixamorig def cc base bip valve biped bn bone bend col"",
  ""controls"": ""ik fk pole target ctrl control mch org twist roll stretch heel end nub helper"",
  ""sharedWordShare"": 0.5,
  ""minSharingJoints"": 5
}";
    }
}
