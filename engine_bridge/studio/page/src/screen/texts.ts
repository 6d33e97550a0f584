/** Texts of the visitors' screen, by language. `{n}` is a number of minutes. */

export interface Texts {
  readonly invite: string;
  readonly stand: string;
  readonly raise_hands: string;
  readonly count: string;
  readonly recording: string;
  readonly making: string;
  readonly film: string;
  readonly minutes: string;
}

export const TEXTS: Readonly<Record<string, Texts>> = {
  en: {
    invite: "Come here. It moves as you do!",
    stand: "Stand here, and stand still",
    raise_hands: "Raise both hands to make your film",
    count: "Get ready!",
    recording: "You are recorded. Raise both hands to stop",
    making: "Your film is being made",
    film: "Here is your film!",
    minutes: "Scan it with your phone. It is there for {n} minutes.",
  },
  de: {
    invite: "Komm her. Es bewegt sich wie du!",
    stand: "Stell dich hierhin und steh still",
    raise_hands: "Heb beide Hände für deinen Film",
    count: "Mach dich bereit!",
    recording: "Du wirst aufgenommen. Heb beide Hände zum Aufhören",
    making: "Dein Film wird gemacht",
    film: "Hier ist dein Film!",
    minutes: "Scann ihn mit dem Handy. Er bleibt {n} Minuten.",
  },
  es: {
    invite: "Ven aquí. ¡Se mueve como tú!",
    stand: "Ponte aquí y quédate quieto",
    raise_hands: "Levanta las dos manos para hacer tu película",
    count: "¡Prepárate!",
    recording: "Te estamos grabando. Levanta las dos manos para parar",
    making: "Estamos haciendo tu película",
    film: "¡Aquí está tu película!",
    minutes: "Escanéala con el móvil. Estará ahí {n} minutos.",
  },
  fr: {
    invite: "Approchez. Il bouge comme vous !",
    stand: "Placez-vous ici, sans bouger",
    raise_hands: "Levez les deux mains pour faire votre film",
    count: "Préparez-vous !",
    recording: "On vous filme. Levez les deux mains pour arrêter",
    making: "Votre film se prépare",
    film: "Voici votre film !",
    minutes: "Scannez-le avec votre téléphone. Il reste {n} minutes.",
  },
  it: {
    invite: "Vieni qui. Si muove come te!",
    stand: "Mettiti qui e resta fermo",
    raise_hands: "Alza le due mani per fare il tuo film",
    count: "Preparati!",
    recording: "Ti stiamo registrando. Alza le due mani per finire",
    making: "Il tuo film è in preparazione",
    film: "Ecco il tuo film!",
    minutes: "Scansionalo con il telefono. Resta {n} minuti.",
  },
  nl: {
    invite: "Kom hier. Het beweegt zoals jij!",
    stand: "Ga hier staan en sta stil",
    raise_hands: "Steek beide handen op voor je film",
    count: "Maak je klaar!",
    recording: "Je wordt opgenomen. Steek beide handen op om te stoppen",
    making: "Je film wordt gemaakt",
    film: "Hier is je film!",
    minutes: "Scan hem met je telefoon. Hij blijft {n} minuten.",
  },
};
